"""Numbers that depend on each other, by the correlations of their normal scores (a Gaussian copula)."""

import numpy as np
from numpy.typing import NDArray

from rbfmu.ensembles.members.distributions import normal_scores, of_scores, values_of
from rbfmu.scene.correlation import Correlation, lower_factor
from rbfmu.scene.ensemble import Ensemble

Array = NDArray[np.float64]


def values(ensemble: Ensemble, cube: Array) -> dict[str, Array]:
    """Return the values (count,) of all numbers that vary, by name, at points (count, n) of the unit cube."""
    marginals = ensemble.varying
    scores = _correlated(ensemble.correlation, {m.name: cube[:, k] for k, m in enumerate(marginals)})
    return {
        m.name: of_scores(m, scores[m.name]) if m.name in scores else values_of(m, cube[:, k])
        for k, m in enumerate(marginals)
    }


def _correlated(correlation: Correlation | None, places: dict[str, Array]) -> dict[str, Array]:
    """Return the normal scores of those numbers that depend on each other.

    The sums are taken term by term: a product of matrices may round otherwise in a larger chunk.
    """
    if correlation is None:
        return {}
    factor = lower_factor(correlation.correlations)
    assert factor is not None
    independent = [normal_scores(places[name]) for name in correlation.components]
    found = {}
    for name, row in zip(correlation.components, factor, strict=True):
        total = np.zeros(len(independent[0]))
        for share, z in zip(row, independent, strict=True):
            if share:
                total = total + share * z
        found[name] = total
    return found
