"""The same settings through a real FMU, by FMI's functions."""

import numpy as np

from tests.support.fmu.fmu_importer import OK
from tests.support.quadruple.driving import course


def seen_by_importer(fmu, scene, setting):
    """As `driving.seen`: a refusal's message and {}, or "" and the rows of all quantities."""
    instance = fmu.instance()
    try:
        return _driven(instance, scene, setting)
    finally:
        instance.free()


def _driven(instance, scene, setting):
    fmu = instance.fmu
    assert instance.setup(scene.run.start, scene.run.stop) == OK
    assert instance.enter() == OK
    for block, values in setting.changes.items():
        if instance.set(dict(zip(_names(fmu, "parameter", block), values, strict=True))) != OK:
            return _said(instance), {}
    if instance.exit() != OK:
        return _said(instance), {}
    lengths, rows_of, stride = course(scene, setting)
    recorded = {name: [] for name in scene.outputs.quantities}
    time = scene.run.start
    for k in range(len(lengths) + 1):
        for port, rows in rows_of.items():
            names = _names(fmu, "input", port)
            assert instance.set(dict(zip(names, rows[max(k - 1, 0)].tolist(), strict=True))) == OK
        if k:
            if instance.step(time, lengths[k - 1]) != OK:
                return f"status {instance.status()}: {_said(instance)}", {}
            time += lengths[k - 1]
        if k % stride == 0 or k == len(lengths):
            for name, values in recorded.items():
                values.append(instance.get(*_names(fmu, "output", name)))
    return "", {name: np.array(rows) for name, rows in recorded.items()}


def _names(fmu, causality, block):
    return [name for name in fmu.by_causality[causality] if name.split("[")[0] == block]


def _said(instance):
    return " ".join(message[-1].decode() for message in instance.log)
