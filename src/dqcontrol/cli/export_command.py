"""Write a controller as a library in C, or the signals of a run for other programs."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.cli.options import Force, Out

_SIGNALS = (".csv", ".parquet", ".mat")


def export(
    source: Path,
    path: Path | None = None,
    /,
    *,
    law: str | None = None,
    target: str | None = None,
    out: Out = None,
    force: Force = False,
) -> None:
    """Write the controller of a spec as a library in C; or all signals of a run for other programs.

    Parameters
    ----------
    source
        Spec (YAML file) of a controller; or folder of a run.
    path
        Of a run: new file for its signals; its suffix chooses the format: .csv, .parquet or .mat.
    law
        Of a spec with several laws: label of the one to export.
    target
        Processor of a controller: native (this one), x86-64-v2, x86-64-v3, aarch64, armv7, riscv64, cortex-m4f or
        cortex-m7.
    out
        Of a spec: new folder for the library.
    force
        Replace an existing file, or an earlier folder.
    """
    from dqcontrol.errors import ShapeError

    if source.is_dir() or (path is not None and not source.exists()):
        _export_signals(source, path, is_controller=bool(law or target or out), force=force)
        return
    if path is not None:
        what = f"write dqcontrol export {source} --out FOLDER" if source.suffix in (".yaml", ".yml") else ""
        raise ShapeError(
            f"{source}: is not the folder of a run, whose signals {path} could take; {what}".rstrip("; ")
        )
    if out is None:
        raise ShapeError(f"out: missing: write dqcontrol export {source} --out FOLDER")
    from dqcontrol.export import export_controller

    done = export_controller(source, out, law=law, target=target or "native", force=force)
    print(
        f"{done.target}: {done.code / 1024:.0f} kB of code, {done.constants / 1024:.0f} kB of constants, "
        f"{done.controller / 1024:.1f} kB a controller; law {done.law_hash}"
    )
    print(f"results: {done.folder} (try: make -C {done.folder} test)")


def _export_signals(run: Path, path: Path | None, *, is_controller: bool, force: bool) -> None:
    from dqcontrol.errors import ShapeError
    from dqcontrol.experiments import load_run

    if is_controller:
        raise ShapeError(f"{run}: is a folder; a controller is exported from its spec: {run / 'spec.yaml'}")
    if path is None:
        raise ShapeError(
            f"{run}: is a folder; name a file for its signals ({', '.join(_SIGNALS)}), or give a spec for a controller"
        )
    print(f"results: {load_run(run).export(path, force=force)}")
