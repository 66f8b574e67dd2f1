"""The style sheet of the report, with a light and a dark theme."""

from typing import Final

# Success and failure are blue and orange, which colour-blind readers can distinguish.
STYLE: Final = """
:root { --ink: #1b1f24; --dim: #626b76; --page: #fff; --panel: #f5f7f9; --line: #dde2e8;
  --good: #2f74c0; --bad: #d9722b; --soft: #a9c8ea; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e9ed; --dim: #98a2ae; --page: #14171b;
  --panel: #1d2227; --line: #333b44; --good: #5b9ee0; --bad: #e8924f; --soft: #2f527a; } }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 960px; margin: 0 auto; padding: 32px 24px 64px; }
h1 { font-size: 30px; margin: 0 0 4px; letter-spacing: -0.01em; }
h2 { font-size: 19px; margin: 40px 0 10px; }
code { font: 13px/1.5 ui-monospace, "SF Mono", Menlo, "DejaVu Sans Mono", monospace; }
h2 code { font-size: 17px; }
.command { margin: 0 0 24px; color: var(--dim); overflow-wrap: anywhere; }
.warning { border-left: 4px solid var(--bad); background: var(--panel); padding: 8px 14px; }
.dim { color: var(--dim); font-size: 13.5px; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(200px, 1fr)); gap: 14px; }
.tile { background: var(--panel); border: 1px solid var(--line); border-radius: 10px; padding: 14px 18px; }
.figure { font-size: 32px; font-weight: 650; line-height: 1.25; font-variant-numeric: tabular-nums; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th { text-align: left; font-weight: 600; font-size: 13px; color: var(--dim); white-space: nowrap; }
th, td { padding: 5px 12px 5px 0; border-bottom: 1px solid var(--line); vertical-align: middle; }
td { white-space: nowrap; }
.number { text-align: right; }
.replay { user-select: all; white-space: normal; overflow-wrap: anywhere; }
.legend { color: var(--dim); font-size: 13.5px; margin: 0 0 6px; }
.legend i { display: inline-block; width: 11px; height: 11px; border-radius: 2px; margin: 0 4px 0 12px; }
.legend i.good { background: var(--good); margin-left: 0; }
.legend i.bad { background: var(--bad); }
svg.wide { width: 100%; height: auto; display: block; }
svg.rate { display: block; width: 100%; min-width: 220px; max-width: 420px; margin: 0 auto; }
svg .grid { stroke: var(--line); }
svg .axis { stroke: var(--dim); stroke-width: 1; }
svg.rate .axis { stroke: var(--line); }
svg .whisker { fill: var(--soft); }
svg .dot, svg .good { fill: var(--good); }
svg .bad { fill: var(--bad); }
svg .label { fill: var(--dim); font-size: 12px; }
"""
