"""Equations as MathML, which browsers draw themselves: no script, no font, no request."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml


def setup(app: Any) -> dict[str, bool]:
    """Replace the HTML of inline and displayed equations."""
    app.add_node(nodes.math, override=True, html=(_inline, None))
    app.add_node(nodes.math_block, override=True, html=(_block, None))
    app.set_html_assets_policy("per_page")
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    number = node.get("number")
    tag = f'<span class="eqno">({number})</span>' if number else ""
    ids = "".join(f'<span id="{one}"></span>' for one in node["ids"])
    equation = tex2mathml(node.astext(), as_block=True)
    translator.body.append(f'<div class="math">{ids}{tag}{equation}</div>')
    raise nodes.SkipNode
