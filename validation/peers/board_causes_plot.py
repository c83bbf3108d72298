"""Errors by cause as bars to both sides of nothing: a drawing of ours, as an <svg> element."""

from __future__ import annotations

import math
from collections.abc import Sequence

from markupsafe import escape

from palpate.validation.peers.board_judge import LAW, MESH, SOLVER, STEP, Score
from palpate.validation.quoting import visible
from palpate.validation.report.plots import BLUE, GREY, OCHRE, RED

_COLOURS = {LAW: RED, MESH: BLUE, STEP: OCHRE, SOLVER: GREY}
_ROW, _LEFT, _WIDTH, _TOP = 24, 190, 760, 34
_MARGIN = 1.06
# Beyond, a body is not where it should be at all; the number stands beside the bar.
_MOST = 1.0


def causes_svg(labels: Sequence[str], scores: Sequence[Score]) -> str:
    """A bar for each answer whose causes are known; "" where there is none."""
    rows = [(label, score) for label, score in zip(labels, scores, strict=True) if score.causes]
    if not rows:
        return ""
    ends = [_ends(score) for _, score in rows]
    low = min(-0.02, *(max(-_MOST, end[0]) for end in ends)) * _MARGIN
    high = max(0.02, *(min(_MOST, end[1]) for end in ends)) * _MARGIN
    span = _WIDTH - _LEFT - 20

    def x(value: float) -> float:
        return _LEFT + span * (min(max(value, low), high) - low) / (high - low)

    height = _TOP + _ROW * len(rows) + 26
    parts = [
        f'<svg viewBox="0 0 {_WIDTH} {height}" role="img" font-size="12" '
        f'font-family="system-ui, DejaVu Sans, sans-serif" fill="currentColor">'
    ]
    present = [cause for cause in _COLOURS if any(cause in s.causes for _, s in rows)]
    for k, cause in enumerate(present):
        place = _LEFT + 110 * k
        parts.append(f'<rect x="{place}" y="8" width="12" height="12" fill="{_COLOURS[cause]}"/>')
        parts.append(f'<text x="{place + 18}" y="18">{cause}</text>')
    for tick in _ticks(low, high):
        parts.append(
            f'<line x1="{x(tick):.1f}" x2="{x(tick):.1f}" y1="{_TOP}" y2="{height - 24}" '
            f'stroke="{"#5c6670" if tick == 0.0 else "#dde2e7"}"/>'
            f'<text x="{x(tick):.1f}" y="{height - 8}" text-anchor="middle">{100 * tick:g} %</text>'
        )
    for k, (label, score) in enumerate(rows):
        y = _TOP + _ROW * k
        parts.append(
            f'<text x="{_LEFT - 10}" y="{y + 16}" text-anchor="end">{escape(visible(label))}</text>'
        )
        at = {True: 0.0, False: 0.0}
        for cause, value in score.causes.items():
            begin = at[value > 0.0]
            at[value > 0.0] = end = begin + value
            left, right = sorted((x(begin), x(end)))
            if right - left > 0.05:
                parts.append(
                    f'<rect x="{left:.1f}" y="{y + 4}" width="{right - left:.1f}" height="15" '
                    f'fill="{_COLOURS[cause]}"><title>{cause}: {100 * value:+.2g} %</title></rect>'
                )
    return "".join([*parts, "</svg>"])


def _ends(score: Score) -> tuple[float, float]:
    values = [value for value in score.causes.values() if math.isfinite(value)]
    return sum(v for v in values if v < 0.0), sum(v for v in values if v > 0.0)


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers, five or so, nothing among them."""
    rough = (high - low) / 5.0
    base = 10.0 ** math.floor(math.log10(rough))
    step = next(base * factor for factor in (1.0, 2.0, 5.0, 10.0) if base * factor >= rough)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [round(k * step, 12) for k in range(first, last + 1)]
