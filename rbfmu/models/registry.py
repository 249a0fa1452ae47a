"""All models, by the name that plans and FMUs have for them: the rows of `closed_forms` and `integrated`."""

from collections.abc import Iterator

from rbfmu.models.closed_forms import CLOSED_FORMS as CLOSED_FORMS
from rbfmu.models.integrated import INTEGRATED
from rbfmu.models.spec import ModelSpec

MODELS: dict[str, ModelSpec] = {spec.key: spec for spec in (*CLOSED_FORMS, *INTEGRATED)}


def smaller_closed_forms(key: str) -> Iterator[ModelSpec]:
    """Yield the models with a closed form that stand before the one named, all of them where it is none."""
    for spec in CLOSED_FORMS:
        if spec.key == key:
            return
        yield spec
