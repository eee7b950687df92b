"""Functions under decorators, written so that mutmut mutates them.

mutmut leaves out functions that have a decorator. Properties and context managers are a good part of the store, so in
the working copy ``@property def x(...): ...`` becomes ``def x(...): ...`` and ``x = property(x)``, which is the same.
"""

import libcst as cst

PLAIN = frozenset({"property", "contextmanager", "staticmethod", "classmethod"})
KNOWN_TO_MUTMUT = frozenset({"staticmethod", "classmethod"})


def without_decorators(source: str) -> str:
    """The same module with its plain decorators as calls."""
    return cst.parse_module(source).visit(_Calls()).code


class _Calls(cst.CSTTransformer):
    def leave_FunctionDef(
        self, original_node: cst.FunctionDef, updated_node: cst.FunctionDef
    ) -> cst.FunctionDef | cst.FlattenSentinel[cst.BaseStatement]:
        names = [one.decorator.value for one in updated_node.decorators if isinstance(one.decorator, cst.Name)]
        all_plain = len(names) == len(updated_node.decorators) and PLAIN.issuperset(names)
        if not names or not all_plain or (len(names) == 1 and KNOWN_TO_MUTMUT.issuperset(names)):
            return updated_node
        call: cst.BaseExpression = updated_node.name
        for name in reversed(names):
            call = cst.Call(cst.Name(name), [cst.Arg(call)])
        assign = cst.Assign([cst.AssignTarget(updated_node.name)], call)
        return cst.FlattenSentinel([updated_node.with_changes(decorators=[]), cst.SimpleStatementLine([assign])])
