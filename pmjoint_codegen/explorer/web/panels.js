"use strict";
// What is plotted of a run: six panels and one for each estimate, each a specification for a Plot.

const PEAK_ROOM = 1.7; // a plot of v and u shows this multiple of the limits; a larger v is cut, and its peak written
const DEPTH = 14; // decades of V below its largest value

function panelsOf(facts) {
  const unit = (name) => [...facts.signals, ...facts.states].find((item) => item.name === name)?.unit ?? "1";
  const has = (name) => [...facts.signals, ...facts.states].some((item) => item.name === name);
  const axis = (names, of = unit(names[0])) => `${names.map(flat).join(", ")}${of === "1" ? "" : ` [${powers(of)}]`}`;
  const time = (y, right) => ({ x: "t [s]", y, ...(right ? { right } : {}) });
  const plane = facts.start.names.slice(0, 2);
  const chosen = plane.every(has) ? plane : ["x1", "x2"];
  const [first, second] = facts.compensator;
  const lyapunov = has("V") ? "Lyapunov function" : facts.n === facts.nx ? "Lyapunov function (30)" : "Lyapunov function (30), its part in z";
  const list = [
    { id: "output", title: "Output", unit: unit("y"), keys: [["y", "blue"], ["y_r", "orange", true]], labels: time(axis(["y", "y_r"])), build: outputPanel },
    { id: "error", title: "Tracking error", unit: unit("e"), keys: [["e", "blue"]], labels: time(axis(["e"])), build: errorPanel },
    { id: "input", title: "Input", unit: unit("u"), keys: [["v", "orange"], ["u", "blue"]], shaded: true, labels: time(axis(["v", "u"])), build: inputPanel },
    { id: "compensator", title: "Compensator", unit: "", keys: [[first, "blue"], ...(second ? [[second, "orange"]] : [])], labels: time(axis([first]), second && axis([second])), build: compensatorPanel, driven: [first, second] },
    { id: "lyapunov", title: lyapunov, unit: squared(unit("y")), keys: [["V", "green"]], labels: time(`V${squared(unit("y")) === "1" ? "" : ` [${powers(squared(unit("y")))}]`}, logarithmic`), build: lyapunovPanel },
  ];
  for (const { name } of facts.estimates) {
    list.push({ id: `estimate-${name}`, title: `Estimate of ${flat(estimated(name, facts))}`, unit: unit(name), keys: [[name, "blue"]], truth: "the plant's", labels: time(axis([name])), build: estimatePanel });
  }
  if (facts.nx > 1) {
    list.push({ id: "plane", title: "Phase plane", unit: "", keys: [], plane: chosen, labels: { x: axis([chosen[0]]), y: axis([chosen[1]]) }, build: planePanel });
  }
  return list;
}

// The square of a unit, as its text.
function squared(unit) {
  return unit === "1" ? "1" : /^[A-Za-z]+$/.test(unit) ? `${unit}^2` : `(${unit})^2`;
}

// Nothing to scale: every curve is 0 at every instant.
function isZero(series) {
  return series.every((item) => item.y.every((value) => value === 0));
}

function inTime(run, names) {
  return names.map(([name, color, dashed]) => ({ name, x: run.t, y: run.columns[name], color, dash: dashed ? [6, 4] : undefined }));
}

function ghosts(kept, names, colors) {
  return kept ? names.map((name) => ({ x: kept.t, y: kept.columns[name], color: colors.ghost, width: 2.4, ghost: true })) : [];
}

function timeRange(run) {
  return [0, run.settings.horizon];
}

function outputPanel(run, kept, colors) {
  const series = [...ghosts(kept, ["y"], colors), ...inTime(run, [["y_r", colors.orange, true], ["y", colors.blue]])];
  const zero = isZero(series);
  return { series, x: timeRange(run), y: rangeOf(series.map((item) => item.y)), spans: saturatedSpans(run), zero, note: zero ? "exactly 0" : "" };
}

function errorPanel(run, kept, colors) {
  const series = [...ghosts(kept, ["e"], colors), ...inTime(run, [["e", colors.blue]])];
  return { series, x: timeRange(run), y: rangeOf(series.map((item) => item.y)), lines: [[0, colors.soft]], spans: saturatedSpans(run), ...(isZero(series) ? { zero: true, note: "e is exactly 0" } : {}) };
}

function inputPanel(run, kept, colors) {
  const names = [["v", colors.orange], ["u", colors.blue]];
  const series = [...ghosts(kept, ["u"], colors), ...inTime(run, names)];
  series.at(-2).width = 1.3;
  series.at(-1).width = 2.1;
  const [low, high] = run.limits;
  const [peak, instant] = run.peakV;
  const within = [Math.min(PEAK_ROOM * low, 0), Math.max(PEAK_ROOM * high, 0)];
  const y = rangeOf(series.map((item) => item.y), within);
  const zero = isZero(series);
  const cut = peak > Math.max(...y.map(Math.abs));
  const note = zero ? "v and u are exactly 0" : cut ? `|v| reaches ${short(peak, 3)} at ${short(instant, 3)} s` : "";
  return { series, x: timeRange(run), y, lines: zero ? [] : [[low, colors.grey], [high, colors.grey]], note, spans: saturatedSpans(run), zero };
}

function compensatorPanel(run, kept, colors, panel) {
  const [first, second] = panel.driven;
  const series = [...ghosts(kept, [first], colors), ...inTime(run, [[first, colors.blue]])];
  const left = rangeOf(series.map((item) => item.y));
  const spec = { series, x: timeRange(run), y: left, spans: saturatedSpans(run) };
  if (second) {
    spec.series.unshift({ name: second, x: run.t, y: run.columns[second], color: colors.orange, right: true, width: 1.3 });
    spec.right = rangeOf([run.columns[second]]);
    spec.rightColor = colors.orange;
  }
  const zero = isZero(spec.series);
  const why = run.settings.saturation === "clip" ? "plain clipping" : "nothing was clipped";
  return { ...spec, zero, note: zero ? `${first.replace(/\d+$/, "")} is exactly 0: ${why}` : "" };
}

// What an estimate is of: an entry of b or theta, or 1/b_m.
function estimated(name, facts) {
  return name === "rho_hat" ? `1/b${facts.m}` : name.replace(/_hat$/, "");
}

function estimatePanel(run, kept, colors, panel) {
  const name = panel.keys[0][0];
  const truth = run.truths[name];
  const series = [...ghosts(kept, [name], colors), ...inTime(run, [[name, colors.blue]])];
  return { series, x: timeRange(run), y: rangeOf([...series.map((item) => item.y), [truth]]), lines: [[truth, colors.orange]], spans: saturatedSpans(run) };
}

// V has no value at all where a true value is outside its range, or a gain is 0: there is nothing to show.
function lyapunovPanel(run, kept, colors) {
  const series = [...ghosts(kept, ["V"], colors), ...inTime(run, [["V", colors.green]])];
  const absent = series.every((item) => !item.y.some(Number.isFinite));
  const [, high] = rangeOf(series.map((item) => item.y));
  let low = Infinity;
  for (const item of series) for (let i = 0; i < item.y.length; i += 1) if (item.y[i] > 0 && item.y[i] < low) low = item.y[i];
  const top = Math.log10(Math.max(high, 1e-290)) + 0.2;
  const bottom = Math.max(Number.isFinite(low) ? Math.log10(low) - 0.2 : top - 1, top - DEPTH);
  return { series, absent, x: timeRange(run), y: [bottom, Math.max(top, bottom + 1)], log: true, spans: saturatedSpans(run), ...(isZero(series) ? { zero: true, log: false, y: [-1, 1], note: "V is exactly 0" } : {}) };
}

function planePanel(run, kept, colors, panel) {
  const [a, b] = panel.plane;
  const series = [];
  if (kept) series.push({ x: kept.columns[a], y: kept.columns[b], color: colors.ghost, width: 2.4, ghost: true });
  series.push({ name: `(${a}, ${b})`, x: run.columns[a], y: run.columns[b], color: colors.blue });
  const [x, y] = [a, b].map((_, i) => rangeOf(series.map((item) => (i ? item.y : item.x))));
  const last = run.rows - 1;
  const points = [[run.columns[a][0], run.columns[b][0], colors.blue, true], [run.columns[a][last], run.columns[b][last], colors.blue]];
  return { series, x, y, points, plane: true };
}
