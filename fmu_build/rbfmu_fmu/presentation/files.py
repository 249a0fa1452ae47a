"""All files of an FMU that are only to be shown, by their place in the archive."""

from rbfmu.runs.plan import Plan
from rbfmu.scene.scene import Scene
from rbfmu_fmu.archive import xml_bytes
from rbfmu_fmu.description import Description
from rbfmu_fmu.fmi_version import FmiVersion
from rbfmu_fmu.presentation.documentation import EXTERNAL, page
from rbfmu_fmu.presentation.licenses import licenses
from rbfmu_fmu.presentation.osp import osp_description, osp_place
from rbfmu_fmu.presentation.picture import picture
from rbfmu_fmu.presentation.terminals import terminals
from rbfmu_fmu.value_references import scalars


def shown_files(
    scene: Scene, plan: Plan, d: Description, version: FmiVersion, needs_python: bool, with_terminals: bool = False
) -> dict[str, bytes]:
    """Return the files; needs_python: of the pythonfmu kind; with_terminals: list them in FMI 2.0 as well.

    FMI 2.0.4 allows the file, but FMI Library 3 and FMU Container fail at it in an FMU of FMI 2.0.
    """
    course = version.course_of_inputs if d.interpolates_inputs and not needs_python else ""
    has_arrays = version.references is not scalars
    files = {
        version.icon: picture(scene),
        "documentation/index.html": page(scene, plan, d, version.icon, course).encode(),
        **licenses(needs_python),
    }
    if with_terminals or version.name != "2.0":
        files["terminalsAndIcons/terminalsAndIcons.xml"] = xml_bytes(terminals(d, has_arrays))
    if version.name == "2.0":  # the one that libcosim imports
        files[osp_place(d)] = xml_bytes(osp_description(d))
    if needs_python:
        files["documentation/externalDependencies.txt"] = EXTERNAL.encode()
    return files
