"""Sphinx: the pages of this folder, the README and the docstrings as a site that needs no network.

Pages stay plain Markdown, good to read on GitHub too; what only the site can show stands in them as a comment.
"""

import inspect
import itertools
import re
import warnings
from pathlib import Path

from pygments.lexers.special import TextLexer

import dqcontrol

project = "dqcontrol"
author = "the authors of dqcontrol"
release = dqcontrol.__version__
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
]
exclude_patterns = ["_build"]
nitpicky = True
nitpick_ignore_regex = [("py:class", ".*")]  # types of attributes, many not ours

html_theme = "furo"
html_title = f"dqcontrol {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_copyright = False
highlight_language = "text"
copybutton_prompt_text = "$ "
copybutton_line_continuation_character = "\\"

myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]
myst_update_mathjax = False
mathjax_path = "formulas.js"  # KaTeX in MathJax's place, kept in _static: the site needs no network
mathjax_options = {"defer": "defer"}

nb_execution_mode = "force"  # notebooks/ hold no output: it is computed here
nb_execution_raise_on_error = True
nb_execution_timeout = 1800  # s a cell: the first use of kernels compiles them, on a busy machine for minutes
nb_merge_streams = True

autodoc_default_options = {"members": True, "exclude-members": "kernel"}
autodoc_typehints = "none"  # docstrings say shape and unit
autodoc_type_aliases = {name: name for name in ("Array", "ArrayLike")}
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
python_use_unqualified_type_names = True


def fill(app, docname, source):
    """Put in place of a comment what it names: a program, the package's names, the command line's own help."""
    program = r"```{literalinclude} ../\1\n:language: python\n```"
    shown = rf"<details>\n<summary>The program</summary>\n\n{program}\n\n</details>"
    text = re.sub(r"<!-- program: (\S+) -->", shown, source[0])
    text = re.sub(r"<!-- replay: (\S+) -->", lambda found: replay(app, found[1]), text)
    for comment, content in (("names of the package", names), ("command line", commands)):
        marker = f"<!-- {comment} -->"
        if marker in text:
            text = text.replace(marker, content())
    source[0] = text


def replay(app, spec):
    """Run a spec, write a page that plays it beside the site's, and return what shows that in one of them."""
    file = Path(app.outdir, "_static", "replays", f"{Path(spec).stem}.html")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dqcontrol.errors.NoteWarning)
        run = dqcontrol.run(Path(app.srcdir).parent / spec)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(run.view().html, encoding="utf-8")
    size = file.stat().st_size / 1e6
    return (
        f'<iframe class="replay" src="_static/replays/{file.name}" title="{spec} as it moves" loading="lazy">'
        "</iframe>\n\n"
        f"`{spec}` as it moves: drag to look around ({size:.1f} MB, part of this site)."
    )


def names():
    """Return what stands in the package itself, each with its first line."""
    lines = []
    for name in dqcontrol.__all__:
        value = getattr(dqcontrol, name)
        if not inspect.ismodule(value):
            package = value.__module__.split(".")[1]
            first = inspect.getdoc(value).partition("\n")[0].replace("*", r"\*")
            known = getattr(getattr(dqcontrol, package), name, None) is value
            place = f"{package}.{name}" if known else name
            lines.append(f"* {{py:obj}}`dqc.{name} <dqcontrol.{place}>`: {first}")
    return "\n".join(lines)


def commands():
    """Return what ``--help`` says of all commands, as Markdown."""
    from dqcontrol.cli import whole_app

    text = whole_app().generate_docs(output_format="markdown")
    return re.sub(r"docs/([\w-]+\.md)", r"[](\1)", text[text.index("## dqcontrol ") :])


def attributes(app, what, name, obj, options, lines):
    """Give each of several attributes that share a text their own: napoleon takes the first for the other's type."""
    start = lines.index("Attributes") + 2 if "Attributes" in lines else len(lines)
    found = lines[:start]
    for i, line in enumerate(lines[start:], start):
        if re.fullmatch(r"\w+(, \w+)+", line):
            text = list(itertools.takewhile(lambda each: each.startswith(" "), lines[i + 1 :]))
            first, *others = line.split(", ")
            found += [part for each in others for part in (each, *text)] + [first]
        else:
            found.append(line)
    lines[:] = found


def formulas(app, what, name, obj, options, lines):
    """Make `name` a link, and keep signs of formulas, as in x*x_d and |ω|, from being read as markup."""
    if what in ("attribute", "data", "property"):
        lines[0] = lines[0].replace(": ", " – ")  # napoleon takes "a: b" for a type and a text
    code = False
    for i, line in enumerate(lines):
        code = line.lstrip().startswith(">>>") or (code and bool(line.strip()))
        if not code:
            parts = re.split(r"(``.*?``|`.*?`)", line)
            parts[::2] = [re.sub(r"([*|]|_(?=\W|$))", r"\\\1", part) for part in parts[::2]]
            parts[1::2] = [re.sub(r"^`([\w.]+)`$", r":py:obj:`.\1`", part) for part in parts[1::2]]
            lines[i] = re.sub(r"^( *\w)\.$", r"\1\\.", "".join(parts))  # a unit, as in "s.", begins no list


def short_types(app, what, name, obj, options, lines):
    """Say ArrayLike where napoleon has looked up what that stands for."""
    lines[:] = [
        re.sub(r"collections\.abc\.Sequence\[numpy\._typing.*\]", "ArrayLike", line) for line in lines
    ]


def setup(app):
    """Register what changes pages before napoleon reads docstrings, and after."""
    app.connect("source-read", fill)
    app.connect("autodoc-process-docstring", attributes, priority=300)
    app.connect("autodoc-process-docstring", formulas, priority=400)
    app.connect("autodoc-process-docstring", short_types, priority=600)
    app.add_lexer("csv", TextLexer)
