"""Controllers in C answer as Python does, to the last bit, and know nothing of Python."""

from exported import make, needs_c, undefined_symbols

from dqcontrol.compiled.object_code import OF_C


@needs_c
def test_the_library_answers_as_python_does_to_the_last_bit(exported_folder):
    said = make(exported_folder, "test")
    assert "largest difference to Python 0 (bits compared)" in said
    assert "passed" in said


@needs_c
def test_it_asks_only_for_what_c_has(exported_folder):
    make(exported_folder)
    asked = undefined_symbols(exported_folder / "dqc_code.o")
    assert asked <= OF_C
    own = undefined_symbols(exported_folder / "libdqc_controller.a") - asked
    assert {name for name in own if not name.startswith("dqc_")} <= OF_C | {"_GLOBAL_OFFSET_TABLE_", "strcmp"}
