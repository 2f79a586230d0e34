"""The folder of a controller in C: library, header, tests, example, hosts and instructions."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

from dqcontrol.compiled.compile import Kernel
from dqcontrol.compiled.object_code import (
    TargetProcessor,
    code_object,
    constants_object,
    prototype,
    section_sizes,
    target_named,
)
from dqcontrol.contact.contact_layout import WRENCH
from dqcontrol.controller.command_kernel import prepared_memory
from dqcontrol.errors import Error
from dqcontrol.experiments.results_folder import check_new, new_folder
from dqcontrol.export.controller_parts import (
    Changeable,
    ControllerParts,
    changeable_parameters,
    controller_parts,
    stage_symbol,
)
from dqcontrol.export.expected_answers import c_number, vector_rows
from dqcontrol.loop.target_motion import MOVING_SIZE
from dqcontrol.supervisor import supervisor_layout as layout
from dqcontrol.supervisor.interventions import REASONS, SOFT_STOP
from dqcontrol.supervisor.prepared_supervisor import START_TOLERANCE
from dqcontrol.version import __version__

VERSION = (1, 1, 0)  # of the interface of dqc_controller.h

_FILLED = ("dqc_controller.h", "dqc_controller.c", "Makefile", "README.md")
_AS_THEY_ARE = ("dqc_controller.hpp", "main.c", "test.c", "bench.c")  # files that no spec changes
_OF_PLANT = ("dqc_plant.h", "dqc_plant.c")
_PLACES = ("good", "sent", "sent_rate", "position", "sent_then", "usual_effort")  # of a supervisor's state
_BUILT = (  # by `make` in the folder, as its target "clean" has it
    *("dqc_controller.o", "dqc_data.o", "dqc_plant.o", "libdqc_controller.a", "libdqc_controller.so"),
    *("test_controller", "bench_controller", "example"),
    *(f"hosts/realtime/{kind}_{each}" for kind in ("udp", "shared") for each in ("loop", "robot")),
)
_ON_PLANT = ("thread_host.c", "robot_process.c")  # hosts that move it


@dataclass(frozen=True)
class ExportSummary:
    """What was written.

    Attributes
    ----------
    folder
        Where.
    target
        For which processor.
    code, constants
        Bytes of machine code and of constant numbers of the library, without the few of its C source.
    controller
        Bytes of one controller.
    law_hash
        Of all that it computes with.
    """

    folder: Path
    target: str
    code: int
    constants: int
    controller: int
    law_hash: str


def export_controller(
    source: str | Path | dict[str, Any],
    out: str | Path,
    *,
    law: str | None = None,
    target: str = "native",
    force: bool = False,
) -> ExportSummary:
    """Write the controller that a spec describes as a library in C.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary.
    out
        A new folder.
    law
        Label of the law, for specs with several.
    target
        Processor: one of ``dqcontrol.compiled.object_code.TARGETS``.
    force
        Replace the folder, if it holds an earlier export.

    Raises
    ------
    Error
        If something does not fit, cannot be exported, or is too large for the target.

    Examples
    --------
    >>> import dqcontrol as dqc, tempfile
    >>> spec = {
    ...     "name": "rest", "robot": "ur5", "start": [0, -1.2, 1.2, -1, -1.5, 0], "period": 0.002, "duration": 1,
    ...     "reference": {"kind": "set-point"}, "law": {"kind": "proportional", "gain": 5},
    ...     "plant": {"kind": "integrator"},
    ... }
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     done = dqc.export.export_controller(spec, f"{folder}/c")
    ...     sorted(path.name for path in done.folder.glob("*.h"))
    ['dqc_controller.h', 'dqc_kernels.h', 'dqc_plant.h', 'test_vector.h']
    """
    processor = target_named(target)
    folder = Path(out)
    if force and (folder / "dqc_kernels.h").is_file():
        for name in _BUILT:  # what its Makefile made nobody wrote, so it may be replaced
            (folder / name).unlink(missing_ok=True)
    check_new(out, force=force)
    return write_controller(
        controller_parts(source, law, computes=processor.is_bare), out, processor, force=force
    )


def write_controller(
    parts: ControllerParts, out: str | Path, processor: TargetProcessor, *, force: bool = False
) -> ExportSummary:
    """Write the folder of a controller; see `export_controller`."""
    code, numbers = code_object(parts.kernels, processor), constants_object(parts.numbers, processor)
    summary = _summary(Path(out), parts, processor, code, numbers)
    _check_fit(parts, processor, summary)
    parameters = changeable_parameters(parts)
    values = _header_values(parts, processor, summary) | {"PARAMETERS": len(parameters)}
    texts = {name: _filled(name, values) for name in _FILLED} | {
        name: _template(name) for name in _AS_THEY_ARE
    }
    texts["dqc_kernels.h"] = _kernels_header(parts, parameters)
    texts["dqc_data.c"] = _data_source(parts, parameters)
    texts["test_vector.h"] = vector_header(parts, processor)
    with new_folder(out, force=force) as folder:
        (folder / "dqc_code.o").write_bytes(code)
        (folder / "dqc_numbers.o").write_bytes(numbers)
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
        _write_plant(folder, parts, processor)
        if not processor.is_bare and parts.wrench_at < 0:  # which hand no wrench
            _copy_hosts(folder, has_plant=parts.plant is not None)
    return summary


def _copy_hosts(folder: Path, *, has_plant: bool) -> None:
    """Copy the programs that call a controller; those on a plant only where there is one."""
    for room in ("realtime", "ros2_control", "libfranka"):
        source = files("dqcontrol.export") / "hosts" / room
        (folder / "hosts" / room).mkdir(parents=True)
        for file in source.iterdir():
            if has_plant or file.name not in _ON_PLANT:
                (folder / "hosts" / room / file.name).write_bytes(file.read_bytes())


def _template(name: str) -> str:
    return (files("dqcontrol.export") / "c" / name).read_text(encoding="utf-8")


def _filled(name: str, values: dict[str, object]) -> str:
    """Return a template with its @NAMES@ replaced."""
    return re.sub(r"@([A-Z_]+)@", lambda found: str(values[found[1]]), _template(name))


def _sizes(parts: ControllerParts) -> dict[str, int]:
    """Return the sizes of a controller's arrays, at least one number each, as C wants it."""
    n, m = parts.robot.configuration_size, parts.robot.input_size
    supervisor = parts.supervisor[1] if parts.supervisor else None
    return {
        "MEMORY": parts.law.memory.size,
        "STATE": parts.law.state_size,
        "SUPERVISOR": supervisor.memory.size if supervisor else 1,
        "SUPERVISOR_STATE": layout.state_layout.size(n, m) + supervisor.window * m if supervisor else 1,
        "MOVING_SIZE": MOVING_SIZE,
        "PLAN": parts.plan.size,
    }


def _header_values(
    parts: ControllerParts, target: TargetProcessor, summary: ExportSummary
) -> dict[str, object]:
    spec, names = parts.setting.spec, parts.case.names
    kind = str(parts.law_spec.__struct_config__.tag)
    law = " · ".join(name for name in (names.law, names.set) if name) or kind
    return {
        "DESCRIPTION": f"{law} for {parts.robot.name}, from the spec '{spec.name}'.",
        "DQCONTROL": __version__,
        "TARGET": target.name,
        "MAJOR": VERSION[0],
        "MINOR": VERSION[1],
        "PATCH": VERSION[2],
        "VERSION": ".".join(map(str, VERSION)),
        "HASH": summary.law_hash,
        "ROBOT": _c_text(parts.robot.name),
        "LAW": _c_text(law),
        "COORDINATES": parts.robot.configuration_size,
        "INPUTS": parts.robot.input_size,
        "PERIOD": c_number(parts.period),
        "SUPERVISED": int(parts.supervisor is not None),
        "STREAMED": int(parts.takes_streams),
        "HAS_CONTACT": int(parts.wrench_at >= 0),
        "DURATION": c_number(parts.period * (len(parts.samples) - 1)),
        "INTERVENTIONS": ", ".join(f'"{REASONS[2**i]}"' for i in range(len(REASONS))),
        "NATIVE": int(target.is_native),
        "COMPILER": target.compiler,
        "FLAGS": target.flags,
        "RUNNER": target.runner,
        "BARE": "1" if target.is_bare else "",
        "HAS_PLANT": "1" if parts.plant else "",
        "CODE": summary.code,
        "CONSTANTS": summary.constants,
        "CONTROLLER": summary.controller,
        "NAME": spec.name,
        "PERIOD_MS": f"{1e3 * parts.period:g}",
        **_sizes(parts),
    }


def _c_text(text: str) -> str:
    return text.replace("\\", "").replace('"', "'")


def _kernels_header(parts: ControllerParts, parameters: list[Changeable]) -> str:
    """Return what only dqc_controller.c knows: kernels, how they take arrays, and where numbers stand."""
    sizes, n, m = _sizes(parts), parts.robot.configuration_size, parts.robot.input_size
    lines = [
        "/* Of dqc_controller.c alone: compiled functions, and where numbers stand. */",
        '#include "dqc_controller.h"',
        "",
        "/* An array as compiled functions take it: in words. */",
        "#define NUMBERS(data, count) 0, 0, (int64_t)(count), 8, (data), (int64_t)(count), 8",
        "#define ROWS(data, rows, columns) \\",
        "  0, 0, (int64_t)((rows) * (columns)), 8, (data), (int64_t)(rows), (int64_t)(columns), "
        "(int64_t)(8 * (columns)), 8",
        "",
        *(prototype(symbol, kernel.signature) for symbol, kernel in parts.kernels.items()),
        "",
        *(f"extern const double {name}[];" for name in parts.numbers),
        "extern const int64_t dqc_plan[];",
        "extern const int32_t dqc_starts[][2];             /* number of the first state, coordinate that it is */",
        "extern const int32_t dqc_input_coordinates[];",
        "typedef struct { int32_t parameter, of_supervisor, index; double offset, slope; } dqc_place;",
        "extern const dqc_place dqc_places[];              /* numbers that a parameter changes */",
        "",
        *(f"#define DQC_{name} {size}" for name, size in sizes.items()),
        f"#define DQC_SAMPLES {len(parts.samples)}",
        f"#define DQC_REFERENCE {parts.numbers['dqc_reference'].size}",
        f"#define DQC_REFERENCE_RESTS {int(parts.is_at_rest)}",
        f"#define DQC_REFERENCE_COMPUTED {int(parts.path is not None)}",
        f"#define DQC_STARTS {len(parts.starts)}",
        f"#define DQC_PLACES {sum(len(each.places) for each in parameters)}",
        f"#define DQC_TABLE_ROWS {parts.plan_field('table_rows')}",
        f"#define DQC_TABLE_COLUMNS {parts.plan_field('table_columns')}",
        f"#define DQC_MOMENT {len(layout.Moment._fields)}",
        f"#define DQC_SHARES_KINEMATICS {int(parts.shares_kinematics)}",
        f"#define DQC_LOOKS_AT_START {int(parts.looks_at_start)}",
        f"#define DQC_WRENCH_AT {parts.wrench_at}",
        *(f"#define DQC_{name} {place}" for name, place in _kinematics_places(parts).items()),
        *(
            f"#define DQC_{name.upper()} {layout.bounds_layout.place(name, layout.Sizes(inputs=m))}"
            for name in ("lower", "upper")
        ),
        *(f"#define DQC_{name.upper()} {layout.state_layout.place(name, n, m)}" for name in _PLACES),
        f"#define DQC_START_TOLERANCE {START_TOLERANCE!r}",
        *(
            f"#define DQC_{name} {getattr(layout, name)}"
            for name in ("LATENESS", "NOW", "MODE", "FAULT", "AT_REST")
        ),
        f"#define DQC_MODE_STOPPED {layout.STOPPED}",
        f"#define DQC_SOFT_STOP {SOFT_STOP}u",
    ]
    symbols = {i: stage_symbol(name) for i, name in enumerate(parts.law.stages)}
    if parts.shares_kinematics:
        symbols[0] = "dqc_kernel_given"
    calls = (
        f"(plan)[{i}] = (int64_t)(intptr_t)&{each};" for i, each in symbols.items() if each in parts.kernels
    )
    lines += ["", "/* What a step calls. */", " \\\n  ".join(["#define LINK_STAGES(plan)", *calls])]
    return "\n".join(lines) + "\n"


def _kinematics_places(parts: ControllerParts) -> dict[str, int]:
    """Return where law and supervisor take kinematics from, and how many numbers they are."""
    if not parts.shares_kinematics or parts.supervisor is None:
        return {}
    m, sizes = parts.robot.input_size, parts.supervisor[1].sizes
    scratch = layout.supervisor_memory.place("scratch", sizes)
    return {
        "CHAIN": layout.supervisor_memory.place("table", sizes),
        "BUFFER": scratch + layout.scratch_layout.place("buffer", sizes),
        "LAW_KINEMATICS": prepared_memory.place(
            "kinematics", *(parts.plan_field(name) for name in prepared_memory.sizes)
        ),
        "TWIST_JACOBIAN": 8 + 8 * m,
        "KINEMATICS": 8 + 14 * m,
    }


def _data_source(parts: ControllerParts, parameters: list[Changeable]) -> str:
    """Return the small constant tables; large ones are in the object file."""
    plan = ", ".join(str(number) for number in parts.plan)
    starts = ", ".join(f"{{{i}, {j}}}" for i, j in [*parts.starts, (0, 0)])
    coordinates = ", ".join(str(i) for i in parts.robot.input_coordinates)
    listed = "".join(
        f'  {{"{each.name}", {", ".join(map(c_number, (each.value, each.least, each.most)))}, '
        f"{int(each.of_supervisor)}}},\n"
        for each in parameters
    )
    places = "".join(
        f"  {{{k}, {int(each.of_supervisor)}, {place.index}, {c_number(place.offset)}, {c_number(place.slope)}}},\n"
        for k, each in enumerate(parameters)
        for place in each.places
    )
    return f"""/* Small tables of the controller; large ones are in dqc_numbers.o. */
#include "dqc_kernels.h"

const int64_t dqc_plan[] = {{{plan}}};
const int32_t dqc_starts[][2] = {{{starts}}};
const int32_t dqc_input_coordinates[] = {{{coordinates}}};
const dqc_parameter dqc_parameters[DQC_PARAMETERS + 1] = {{
{listed}  {{0, 0.0, 0.0, 0.0, 0}},
}};
const dqc_place dqc_places[] = {{
{places}  {{0, 0, 0, 0.0, 0.0}},
}};
"""


def vector_header(parts: ControllerParts, target: TargetProcessor, *, whole: bool = False) -> str:
    """Return the test vector; of the ``whole`` reference, or of its first seconds."""
    n, m = parts.robot.configuration_size, parts.robot.input_size
    rows = [row.numbers(n, m) for row in vector_rows(parts, whole=whole)]
    lines = (f"  {{{', '.join(map(c_number, row))}}}," for row in rows)
    return "\n".join(
        [
            "/* Calls, answers: request, whether measured, time, age, elapsed, q, wrench, status, interventions, u. */",
            "#include <math.h>",
            f"#define VECTOR_ROWS {len(rows)}",
            f"#define VECTOR_COLUMNS {len(rows[0])}",
            f"#define VECTOR_WRENCH {WRENCH if parts.wrench_at >= 0 else 0}",
            f"#define VECTOR_IS_EXACT {int(target.is_native)}",
            "static const double vector[VECTOR_ROWS][VECTOR_COLUMNS] = {",
            *lines,
            "};",
            "",
        ]
    )


def _write_plant(folder: Path, parts: ControllerParts, target: TargetProcessor) -> None:
    plant = parts.plant
    if plant is None:
        return
    assert isinstance(plant.kernel, Kernel)
    numbers = {
        "dqc_plant_parameters": plant.parameters,
        "dqc_plant_state": plant.state,
        "dqc_plant_start": plant.q,
    }
    (folder / "dqc_plant_code.o").write_bytes(code_object({"dqc_kernel_plant": plant.kernel}, target))
    (folder / "dqc_plant_numbers.o").write_bytes(constants_object(numbers, target))
    values = {
        "PARAMETERS": plant.parameters.size,
        "STATE": max(plant.state.size, 1),
        "STATE_SIZE": plant.state.size,
        "NOISE": plant.noise.shape[1],
        "PROTOTYPE": prototype("dqc_kernel_plant", plant.kernel.signature),
        "WRENCH": (plant.wrench.ctypes.data - plant.state.ctypes.data) // 8 if plant.wrench.size else -1,
        "PLANT": type(parts.case.plant).__struct_config__.tag,
    }
    for name in _OF_PLANT:
        (folder / name).write_text(_filled(name, values), encoding="utf-8")


def _summary(
    out: Path, parts: ControllerParts, target: TargetProcessor, code: bytes, numbers: bytes
) -> ExportSummary:
    sections = section_sizes(code)
    text = sum(size for name, size in sections.items() if name.startswith(".text"))
    kept = [*sections.items(), *section_sizes(numbers).items()]
    constants = sum(size for name, size in kept if ".rodata" in name)
    n, m = parts.robot.configuration_size, parts.robot.input_size
    own = sum(_sizes(parts).values()) + 3 * m + 2 * n + 40
    return ExportSummary(out, target.name, text, constants, 8 * own, parts.law_hash(target))


def _check_fit(parts: ControllerParts, target: TargetProcessor, summary: ExportSummary) -> None:
    """Refuse what is too large for a microcontroller."""
    table = parts.numbers["dqc_reference"].nbytes
    for what, size, most in (
        ("code and constants", summary.code + summary.constants, target.flash),
        ("a controller", summary.controller, target.memory),
    ):
        if most and size > most:
            why = f"; the reference alone takes {table / 1024:,.0f} kB as a table" * (table > most // 2)
            raise Error(
                f"target: {target.name}: {what}: {size / 1024:,.0f} kB, at most {most / 1024:,.0f} kB{why}: "
                "take a set-point, a shorter reference or a longer period"
            )
