"""Griffe: a comment behind a field is its docstring, as the command line's help takes it too."""

import ast
import re

import griffe

COMMENT = re.compile(r"\s#\s+(.*)$")


class FieldComments(griffe.Extension):
    """Reads `pelvis_m: np.ndarray  # (T, 3) ... [m]`."""

    def on_attribute_instance(
        self,
        *,
        node: ast.AST | griffe.ObjectNode,
        attr: griffe.Attribute,
        agent: griffe.Visitor | griffe.Inspector,
        **kwargs: object,
    ) -> None:
        if attr.docstring is not None or not isinstance(node, ast.AnnAssign):
            return
        if not isinstance(attr.parent, griffe.Class) or node.end_lineno is None:
            return
        line = attr.lines_collection[attr.filepath][node.end_lineno - 1]
        if comment := COMMENT.search(line[node.end_col_offset or 0 :]):
            attr.docstring = griffe.Docstring(comment[1], parent=attr, lineno=node.end_lineno)
