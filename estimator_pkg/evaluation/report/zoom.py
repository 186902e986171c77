"""Views of long lines in a page: as many points as one can see, of the part that is looked at."""

from __future__ import annotations

from typing import Any

# Runs in the browser whenever the range moves: of the points in it, the lowest and the highest of
# each of `points` / 2 equal parts, as `thinning.extremes` does; nan (a hole) stays.
CHOOSE = """
if (shown.tags[0]) return;  // once per frame, however many bounds have moved
shown.tags[0] = true;
requestAnimationFrame(() => {
    shown.tags[0] = false;
    const x = whole.data.x, y = whole.data.y, xs = [], ys = [];
    const find = value => {
        let low = 0, high = x.length;
        while (low < high) {
            const middle = (low + high) >> 1;
            if (x[middle] < value) low = middle + 1; else high = middle;
        }
        return low;
    };
    const first = Math.max(0, find(range.start) - 1);
    const last = Math.min(x.length, find(range.end) + 1);
    const length = Math.max(1, Math.ceil(2 * (last - first) / points));
    for (let at = first; at < last; at += length) {
        const end = Math.min(at + length, last);
        let low = at, high = at, hole = -1;
        for (let i = at; i < end; i++) {
            if (y[i] !== y[i]) hole = i;
            if (y[i] < y[low] || y[low] !== y[low]) low = i;
            if (y[i] > y[high] || y[high] !== y[high]) high = i;
        }
        const chosen = new Set([low, high]);
        if (hole >= 0) chosen.add(hole);
        for (const i of [...chosen].sort((a, b) => a - b)) { xs.push(x[i]); ys.push(y[i]); }
    }
    shown.data = {x: xs, y: ys};
});
"""


def zoomed(span: Any, whole: Any, shown: Any, points: int) -> None:
    """Fills the source `shown` from `whole` by what is to be seen in the range `span`."""
    from bokeh.models import CustomJS
    shown.tags = [False]
    choose = CustomJS(args={'range': span, 'whole': whole, 'shown': shown, 'points': points},
                      code=CHOOSE)
    span.js_on_change('start', choose)
    span.js_on_change('end', choose)
