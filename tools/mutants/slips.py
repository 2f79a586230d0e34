"""List the slips of a package as JSON: which file, its text after the slip, what changed. Needs cosmic-ray."""

import difflib
import json
import re
import sys
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

# All of cosmic-ray's changes are many times as many; of an operator the likeliest slip is enough.
_TRIED = re.compile(
    r"core/(ReplaceBinaryOperator_(Add_Sub|Sub_Add|Mul_Div|Div_Mul|BitOr_BitAnd|BitAnd_BitOr)"
    r"|ReplaceComparisonOperator_(Eq_NotEq|NotEq_Eq|Lt_LtE|LtE_Lt|Gt_GtE|GtE_Gt)"
    r"|ReplaceUnaryOperator_Delete_(USub|Not)|Replace(And|Or|True|False|Break|Continue)With\w+"
    r"|AddNot|NumberReplacer|ZeroIterationForLoop)"
)


def slips(path: Path):
    """Yield each slip of a file: its first and last line, and the lines in their place."""
    source = path.read_text()
    nodes = list(ast_nodes(get_ast(source)))
    for name in filter(_TRIED.fullmatch, operator_names()):
        operator = get_operator(name)()
        for occurrence in range(sum(len(list(operator.mutation_positions(node))) for node in nodes)):
            after = mutate_code(source, operator, occurrence)
            changed = [
                each
                for each in difflib.SequenceMatcher(
                    a=source.splitlines(), b=after.splitlines(), autojunk=False
                ).get_opcodes()
                if each[0] != "equal"
            ]
            first, last, start, stop = changed[0][1], changed[-1][2], changed[0][3], changed[-1][4]
            yield {
                "path": str(path),
                "operator": name.removeprefix("core/"),
                "first": first,
                "last": last,
                "lines": after.splitlines()[start:stop],
            }


if __name__ == "__main__":
    found = [slip for path in sorted(Path(sys.argv[1]).rglob("*.py")) for slip in slips(path)]
    print(json.dumps(found))
