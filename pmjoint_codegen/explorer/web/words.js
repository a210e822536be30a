"use strict";
// A run in words and figures: for the row above the plots, and for readers who do not see these.

const SETTLED = "settled (2 %)";

function withUnit(value, unit) {
  return unit && unit !== "1" ? `${value} ${unit}` : value;
}

// Key figures as [name, value, unit]; units: of y and u.
function figuresOf(run, { y, u }) {
  const late = run.settling !== null && run.settling >= run.settings.horizon;
  const settled = run.settling === null ? "–" : late ? "not yet" : short(run.settling);
  const square = squared(y);
  return [
    ["largest |e|", short(run.peakE[0]), y],
    ["final e", short(run.columns.e[run.rows - 1]), y],
    [SETTLED, settled, run.settling === null || late ? "" : "s"],
    ["∫ e² dt", short(run.ise), square === "1" ? "s" : `${square} s`],
    ["largest |v|", short(run.peakV[0]), u],
    ["u at a limit", short(run.saturated), "s"],
    ["switches", String(run.switches.length), ""],
    ["steps", String(run.steps), ""],
  ];
}

// One sentence about a finished run.
function announcement(run, { y, u }) {
  const error = withUnit(short(run.peakE[0]), y);
  return `The run ${run.message}. Largest error ${error}, largest v ${withUnit(short(run.peakV[0]), u)}, u at a limit for ${short(run.saturated)} s.`;
}

// A plot in words: what its curves span, and what is written into it.
function descriptionOf(panel, run, units) {
  const spec = panel.plot.spec;
  const parts = panel.names.map((name) => {
    const of = (value) => withUnit(short(value), units.of(name));
    if (run.columns[name].every((value) => value === 0)) return `${name} is exactly 0`;
    const { low, high, last } = spanOf(run.columns[name]);
    return `${name} from ${of(low)} to ${of(high)}, last ${of(last)}`;
  });
  const more = [spec.note, panel.shaded ? `u is at a limit for ${short(run.saturated)} s` : ""].filter(Boolean);
  return `${panel.title}: ${[...parts, ...more].join("; ")}. Arrow keys read values.`;
}

function spanOf(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return { low, high, last: values[values.length - 1] };
}

// The values at a row, as one line; names: those shown.
function readingOf(run, row, names, units) {
  const values = names.map((name) => `${flat(name)} ${withUnit(short(run.columns[name][row]), units.of(name))}`);
  return `t ${short(run.t[row])} s: ${values.join(", ")}`;
}
