"""Export format `fmu`: the plan and the law of the motor torques as an FMI 3.0 unit.

The unit is for co-simulation. It contains the C export, compiled for this computer and as sources.
It has no states: `plan.*` are functions of time, and the other outputs are functions of the inputs.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

from ssm_planner import ExportError, Format, Plan
from ssm_planner.formats.c import ROBOT_FILE, TRAJECTORY_FILE, export_c
from ssm_planner.publishing import one_line

IDENTIFIER = "ssm"
"""Model identifier, which is also the name of the binary."""
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden")
SYSTEMS = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib")}
"""Name in FMI and file extension of shared libraries, by operating system."""
MACHINES = {"x86_64": "x86_64", "AMD64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
"""Name in FMI by type of processor."""
UNITS = "joints roll, tilt, spin and insertion; rad and N·m, insertion in m and N"
JOINT_VALUES = ("positions", "velocities", "accelerations", "jerks")
VARIABLES = {
    **{f"q{'d' * k}": ("input", f"joint {name}", "") for k, name in enumerate(JOINT_VALUES)},
    **{
        f"plan.q{'d' * k}": ("output", f"planned joint {name}", "0")
        for k, name in enumerate(JOINT_VALUES[:3])
    },
    "plan.motor_torque": ("output", "planned motor torques with exact friction", "0"),
    "effort": ("output", "rigid-body efforts of the input motion", "1 2 3"),
    "motor_torque": ("output", "motor torques of the input motion, exact friction", "1 2 3 4"),
}
"""Causality, description and dependencies of the variables (4,), in the order of ssm_fmu.c."""

FMU = Format("fmu", "ssm_planner_fmu:write", "plan and law of the motor torques as an FMI 3.0 unit")


def write(plan: Plan, certificate: Any, folder: Path, suffix: str) -> dict[str, Any]:
    """Write ssm.fmu and return the entries of the manifest.

    The parameters are those of every writer of a format, see `ssm_planner.Format`. Without a C
    compiler, the unit contains only the sources, and a note says so.
    """
    with TemporaryDirectory() as temporary:
        unit = Path(temporary)
        sources = unit / "sources"
        sources.mkdir()
        details = export_c(plan, certificate, sources, suffix)
        header = f'#define SSM_TOKEN "{plan.sha256}"\n#include "{TRAJECTORY_FILE}{suffix}.h"\n'
        (sources / "ssm_unit.h").write_text(header, encoding="utf-8")
        shutil.copyfile(Path(__file__).parent / "ssm_fmu.c", sources / "ssm_fmu.c")
        names = ["ssm_fmu.c", f"{ROBOT_FILE}{suffix}.c", f"{TRAJECTORY_FILE}{suffix}.c"]
        _write_xml(model_description(plan, suffix), unit / "modelDescription.xml")
        _write_xml(build_description(names), sources / "buildDescription.xml")
        notes = [*details["notes"], *compile_unit(unit, names)]
        with zipfile.ZipFile(folder / f"{IDENTIFIER}{suffix}.fmu", "w") as archive:
            for path in sorted(file for file in unit.rglob("*") if file.is_file()):
                # A fixed date: the same plan gives the same bytes.
                entry = zipfile.ZipInfo(path.relative_to(unit).as_posix(), (1980, 1, 1, 0, 0, 0))
                entry.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(entry, path.read_bytes())
    return {**details, "notes": notes}


def compile_unit(unit: Path, names: list[str]) -> Iterator[str]:
    """Compile the sources of a unit for this computer, and yield notes for the manifest."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    system, extension = SYSTEMS.get(platform.system(), ("", ""))
    machine = MACHINES.get(platform.machine())
    if compiler is None or not system or machine is None:
        yield "the unit contains sources only: no C compiler, or an unknown kind of computer"
        return
    binaries = unit / "binaries" / f"{machine}-{system}"
    binaries.mkdir(parents=True)
    target = binaries / (IDENTIFIER + extension)
    command = [compiler, *FLAGS, "-o", str(target), *names, "-lm"]
    done = subprocess.run(
        command, cwd=unit / "sources", capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise ExportError(f"the C compiler cannot translate the unit: {done.stderr.strip()}")
    yield f"the unit contains a binary for {machine}-{system}, and the sources for other computers"


def model_description(plan: Plan, suffix: str = "") -> ElementTree.Element:
    """Return modelDescription.xml. A suffix marks the unit of an unverified plan."""
    mark = "UNVERIFIED: the plan has no passed certificate. " if suffix else ""
    duration = repr(float(plan.motion.duration))
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=one_line(plan.robot.name),
        instantiationToken=plan.sha256,
        description=f"{mark}Plan and exact inverse dynamics with the friction of the drives",
        generationTool="ssm-planner",
        variableNamingConvention="structured",
    )
    capabilities = {"canHandleVariableCommunicationStepSize": "true"}
    ElementTree.SubElement(root, "CoSimulation", modelIdentifier=IDENTIFIER, **capabilities)
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0", stopTime=duration)
    variables = ElementTree.SubElement(root, "ModelVariables")
    structure = ElementTree.SubElement(root, "ModelStructure")
    time = {"name": "time", "valueReference": "0", "causality": "independent"}
    ElementTree.SubElement(variables, "Float64", time, variability="continuous")
    unknowns = []
    for reference, (name, (causality, text, known)) in enumerate(VARIABLES.items(), start=1):
        values = {"name": name, "valueReference": str(reference), "causality": causality}
        values["description"] = f"{text} ({UNITS})"
        if causality == "input":
            values["start"] = "0 0 0 0"
        else:
            unknowns.append({"valueReference": str(reference), "dependencies": known})
        variable = ElementTree.SubElement(variables, "Float64", values)
        ElementTree.SubElement(variable, "Dimension", start="4")
    for kind in ("Output", "InitialUnknown"):
        for unknown in unknowns:
            ElementTree.SubElement(structure, kind, unknown)
    return root


def build_description(names: list[str]) -> ElementTree.Element:
    """Return buildDescription.xml, which lists the source files."""
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=IDENTIFIER)
    files = ElementTree.SubElement(build, "SourceFileSet", language="C99")
    for name in names:
        ElementTree.SubElement(files, "SourceFile", name=name)
    return root


def _write_xml(root: ElementTree.Element, path: Path) -> None:
    """Write an indented XML file."""
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
