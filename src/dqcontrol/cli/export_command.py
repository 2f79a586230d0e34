"""Write a controller as a library in C."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from dqcontrol.cli.options import Force

# named here: looking at `TARGETS` would load the compiler
Target = Literal["native", "x86-64-v2", "x86-64-v3", "aarch64", "armv7", "riscv64", "cortex-m4f", "cortex-m7"]


def export(
    spec: Path,
    /,
    *,
    law: str | None = None,
    target: Target = "native",
    out: Annotated[Path, Parameter(name=["--out", "-o"])],
    force: Force = False,
) -> None:
    """Write the controller of a spec as a library in C, with its tests.

    Parameters
    ----------
    spec
        YAML file of a controller.
    law
        Of a spec with several laws: label of the one to export.
    target
        Processor; native is this one.
    out
        New folder for the library.
    force
        Replace an earlier folder.
    """
    from dqcontrol.errors import ShapeError
    from dqcontrol.export import export_controller

    if spec.is_dir():
        raise ShapeError(
            f"{spec}: is a folder; a controller is exported from its spec, {spec / 'spec.yaml'}; "
            f"the signals of a run: dqcontrol convert {spec} log.csv"
        )
    done = export_controller(spec, out, law=law, target=target, force=force)
    print(f"results: {done.folder} (try: make -C {done.folder} test)")
    print(
        f"{done.target}: {done.code / 1024:.0f} kB of code, {done.constants / 1024:.0f} kB of constants, "
        f"{done.controller / 1024:.1f} kB a controller; law {done.law_hash}"
    )
