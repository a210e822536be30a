"use strict";
// One model's closed loop: settings in, a run out. The loop itself is the compiled C of `pmjoint simulate`.

const PLACES = ["p", "state", "settings", "limits", "thresholds", "modes", "chain", "breaks", "segments", "times",
  "results", "rows", "signals", "peaks", "peakTimes", "switchTimes", "switchModes", "filter"];
const [MOST_ROWS, MOST_THRESHOLDS, MOST_BREAKS, MOST_HISTORY] = [10001, 32, 4096, 4096];
const BUDGET = 2000; // steps between two looks at the clock
const PATIENCE = 1500; // ms; a run that takes longer is given up
const USUAL = 1e4; // of the states, beyond which a run is lost
const STATUS = {
  0: "was given up: it takes too long for a page",
  1: "reached the horizon",
  2: "diverged: a state passed its limit",
  3: "lost: a state or the control stopped being a finite number",
  4: "stalled: no step that time can resolve follows the model",
  5: "used up its steps",
  6: "used up its saturation switches",
  7: "failed: a kernel reported a failure",
  9: "is stuck to a kink",
};

class Engine {
  static async make(facts) {
    const bytes = Uint8Array.from(atob(facts.wasm), (letter) => letter.charCodeAt(0));
    const { instance } = await WebAssembly.instantiate(bytes, {});
    return new Engine(facts, instance.exports);
  }

  constructor(facts, exports) {
    this.facts = facts;
    this.wasm = exports;
    exports._initialize?.();
    this.at = Object.fromEntries(PLACES.map((name, i) => [name, exports.explorer_place(i)]));
    this.columns = new Map();
    facts.signals.forEach((item, i) => this.columns.set(item.name, ["signals", i, facts.signals.length]));
    facts.states.forEach((item, i) => this.columns.set(item.name, ["rows", i, facts.states.length]));
  }

  view(place, length) {
    return new Float64Array(this.wasm.memory.buffer, this.at[place], length);
  }

  // Every parameter by name, as the kernels take it; throws an Error with one line for the reader.
  values(settings) {
    const { facts } = this;
    const values = {};
    for (const item of facts.parameters) {
      values[item.name] = toSI(settings.values[item.name] ?? item.value, item.scale);
    }
    for (const [own, name] of Object.entries(facts.own)) {
      if (settings.values[own] === undefined) values[own] = values[name];
    }
    values.compensator = settings.saturation === "clip" ? 0 : 1;
    const wrong = complaint(facts, values);
    if (wrong) throw new Error(wrong);
    return values;
  }

  // The derived coefficients too, for the law beside its numbers.
  numbers(values) {
    const all = { ...values };
    for (const item of this.facts.derived) all[item.name] = evaluate(item.tree, all);
    return all;
  }

  startStates(x0, values) {
    const { start } = this.facts;
    const known = { ...values };
    start.names.forEach((name, i) => { known[name] = x0[i]; });
    return start.terms.map((term) => evaluate(term, known));
  }

  divergence(values, settings) {
    const { facts } = this;
    let start = 100 * Math.max(0, ...settings.x0.map(Math.abs));
    if (settings.start === "matched") {
      const rates = facts.positive.filter((name) => /^ck\d+$/.test(name)).map((name) => values[name]);
      start *= Math.max(1, ...rates) ** (facts.rho - 1);
    }
    const pressures = facts.states.slice(0, facts.nx).some((item) => item.unit === "Pa") && "P_max" in values;
    const supply = pressures ? 4 * (values.P_max_plant ?? values.P_max) : 0;
    const gain = Math.abs(evaluate(facts.leading, values));
    const usual = USUAL * this.derivatives(values) * Math.max(1, 1 / gain);
    return Math.min(Math.max(usual, start, supply), Number.MAX_VALUE);
  }

  derivatives(values) {
    const { n, nx } = this.facts;
    if (n <= 2) return 1;
    const bandwidth = Math.abs(values[`k${n}`]) ** (1 / n);
    const zero = this.startStates(Array(nx).fill(0), values);
    const apart = Array.from({ length: nx }, (_, j) => this.startStates(zero.map((_, i) => Number(i === j)), values))
      .flatMap((states) => states.map((value, i) => Math.abs(value - zero[i]))).filter(Number.isFinite);
    return Number(Math.max(1, bandwidth ** (n - 2), ...apart).toPrecision(3));
  }

  chainOf(values, period) {
    const { chain, limit } = this.facts;
    const of = (key, otherwise) => (key in chain ? values[chain[key]] : otherwise);
    const zone = of("dead_zone", 0);
    const numbers = {
      zone,
      own: values[`${chain.dead_zone}_plant`] ?? zone,
      lower: of("lower", -values[limit]),
      upper: of("upper", values[limit]),
      reach: of("rate", Infinity) * period,
      delay: of("delay", 0),
      samples: of("delay_samples", 0),
      jitter: of("jitter", 0),
      resolution: of("resolution", 0),
      noise: of("noise", 0),
      seed: of("seed", 0),
      gain: -Math.expm1(-of("filter", Infinity) * period),
      period,
    };
    const history = Math.ceil((numbers.delay + numbers.jitter) / period) + Math.trunc(numbers.samples) + 3;
    return { numbers, history };
  }

  // A run; throws an Error with one line where the settings allow none.
  run(settings) {
    const { facts, wasm } = this;
    const values = this.values(settings);
    const sampled = settings.controller === "sampled";
    const period = settings.sample_time;
    const looped = sampled && facts.order.looped;
    const link = this.chainOf(values, sampled ? period : 1);
    if (sampled && !(period > 0 && period <= settings.horizon)) throw new Error("the sample time exceeds the horizon");
    if (looped && link.numbers.jitter >= period) throw new Error("the jitter is not below the sample time");
    if (looped && link.history > MOST_HISTORY) throw new Error("the delay is too long for a page");

    const p = this.view("p", facts.parameters.length + (facts.reference ? facts.reference.rows[0].length : 0));
    p.set(facts.parameters.map((item) => values[item.name]));
    const breaks = this.putReference(settings.horizon, p);
    wasm.explorer_actuation();
    const limits = chunks(this.view("limits", 4 * facts.nw), 4);
    const valve = "dead_zone" in facts.chain ? link.numbers : null;
    const actuator = makeActuator(limits, valve);
    if (actuator.thresholds.length > MOST_THRESHOLDS) throw new Error("the actuator has too many limits for a page");
    this.view("thresholds", MOST_THRESHOLDS).set(actuator.thresholds);
    this.view("modes", (MOST_THRESHOLDS + 1) * 2 * facts.nw).set(actuator.modes.flat());
    this.view("chain", 13).set(Object.values(link.numbers));

    const state = this.view("state", facts.states.length).fill(0);
    state.set(this.startStates(settings.x0, values));
    facts.start.guesses.forEach((name, i) => { if (name) state[facts.nx + i] = values[name]; });
    if (settings.start === "matched") wasm.explorer_match(looped ? wasm.explorer_read(state[0]) : state[0]);
    const count = this.putTimes(settings);
    this.view("settings", 7).set([settings.horizon, period, this.divergence(values, settings), count,
      actuator.thresholds.length, breaks, looped ? link.history : 0]);
    return this.integrate(settings, values, actuator, sampled);
  }

  putReference(horizon, p) {
    const { reference } = this.facts;
    if (!reference) return 0;
    const within = reference.breaks.filter((instant) => instant < horizon);
    if (within.length > MOST_BREAKS) throw new Error("the reference has too many pieces for a page");
    const size = reference.rows[0].length;
    this.view("breaks", MOST_BREAKS).set(within);
    this.view("segments", (MOST_BREAKS + 1) * size).set(reference.rows.slice(0, within.length + 1).flat());
    p.set(reference.rows[0], p.length - size);
    return within.length;
  }

  putTimes({ horizon, output_step: step }) {
    const count = 1 + Math.ceil((horizon / step) * (1 - 1e-12));
    if (!(count <= MOST_ROWS)) throw new Error("the horizon holds too many output instants for a page");
    const times = this.view("times", count);
    for (let i = 0; i < count; i += 1) times[i] = i * step;
    times[count - 1] = horizon;
    return count;
  }

  integrate(settings, values, actuator, sampled) {
    const { wasm, facts } = this;
    const begun = performance.now();
    wasm.explorer_begin(Number(sampled));
    while (wasm.explorer_advance(BUDGET) === 0 && performance.now() - begun < PATIENCE);
    if (wasm.explorer_signals()) throw new Error("a kernel reported a failure");
    const [status, reached, rows, steps, integral, band, settled, firstMode, switches] = this.view("results", 11);
    const run = {
      status,
      reached,
      rows,
      steps,
      settings,
      values,
      wall: performance.now() - begun,
      t: this.view("times", rows),
      message: `${STATUS[status] ?? "failed"}, t = ${short(reached)} s`,
      ise: integral,
      settling: band > 0 && status === 1 ? settled : null,
      column: (name) => this.column(name, rows),
    };
    run.initialMode = actuator.labels[firstMode];
    run.switches = this.switches(actuator, firstMode, switches);
    run.saturated = saturatedTime(run);
    const [peaks, peakTimes] = ["peaks", "peakTimes"].map((name) => this.view(name, facts.states.length + 3));
    run.peak = (name) => {
      const index = { v: 0, e: 1 }[name];
      const i = index === undefined ? facts.states.findIndex((item) => item.name === name) : facts.states.length + index;
      return [peaks[i], peakTimes[i]];
    };
    run.V = lyapunov(this, values, run);
    return run;
  }

  column(name, rows) {
    const [place, offset, stride] = this.columns.get(name);
    const all = this.view(place, rows * stride);
    const found = new Float64Array(rows);
    for (let i = 0, j = offset; i < rows; i += 1, j += stride) found[i] = all[j];
    return found;
  }

  switches(actuator, firstMode, count) {
    const [times, modes] = ["switchTimes", "switchModes"].map((name) => this.view(name, count));
    const found = [];
    let before = actuator.labels[firstMode];
    for (let i = 0; i < count; i += 1) {
      const label = actuator.labels[modes[i]];
      if (label !== before) found.push([times[i], label]);
      before = label;
    }
    return found;
  }
}

function chunks(array, size) {
  return Array.from({ length: array.length / size }, (_, i) => [...array.subarray(i * size, (i + 1) * size)]);
}

// Intervals in which u is at a limit, as [from, to, side].
function saturatedSpans(run) {
  const instants = [0, ...run.switches.map(([t]) => t), run.reached];
  const labels = [run.initialMode, ...run.switches.map(([, label]) => label)];
  return labels.map((label, i) => [instants[i], instants[i + 1], label]).filter(([, , label]) => label !== 0);
}

function saturatedTime(run) {
  return saturatedSpans(run).reduce((sum, [from, to]) => sum + (to - from), 0);
}

// V of (30) at the output instants: sum w_i z_i^2/2 + sum epsilon' P epsilon/(2 e_i). Where the plant has other states
// than the design, epsilon is not known and the sum over z is returned. An adaptive controller has a V of its own.
function lyapunov(engine, values, run) {
  const { n, nx, rho } = engine.facts;
  if (engine.columns.has("V")) return run.column("V");
  const total = new Float64Array(run.rows);
  const kappa = values.input_scale;
  for (let i = 1; i <= rho; i += 1) {
    const [z, weight] = [run.column(`z${i}`), i === 1 ? 0.5 : (kappa * kappa) / 2];
    for (let row = 0; row < run.rows; row += 1) total[row] += weight * z[row] * z[row];
  }
  if (n !== nx) return total;
  const P = lyapunovMatrix(chunks(engine.view("filter", n * n), n));
  let weight = 0;
  for (let i = 1; i <= rho; i += 1) weight += 1 / (2 * values[`e${i}`]);
  const errors = Array.from({ length: n }, (_, i) => {
    const [x, estimate] = [run.column(`x${i + 1}`), run.column(`x_hat${i + 1}`)];
    return x.map((value, row) => value - estimate[row]);
  });
  for (let row = 0; row < run.rows; row += 1) {
    let sum = 0;
    for (let i = 0; i < n; i += 1) for (let j = 0; j < n; j += 1) sum += errors[i][row] * P[i][j] * errors[j][row];
    total[row] += weight * sum;
  }
  return total;
}

// P of P A + A' P = -2 I.
function lyapunovMatrix(A) {
  const n = A.length;
  const system = [];
  for (let i = 0; i < n; i += 1) {
    for (let j = 0; j < n; j += 1) {
      const row = Array(n * n + 1).fill(0);
      for (let k = 0; k < n; k += 1) {
        row[i * n + k] += A[k][j];
        row[k * n + j] += A[k][i];
      }
      row[n * n] = i === j ? -2 : 0;
      system.push(row);
    }
  }
  const solution = solved(system);
  return Array.from({ length: n }, (_, i) => solution.slice(i * n, (i + 1) * n));
}

// A linear system with its right-hand side as last column, by elimination with pivots.
function solved(system) {
  const size = system.length;
  for (let i = 0; i < size; i += 1) {
    let pivot = i;
    for (let k = i + 1; k < size; k += 1) if (Math.abs(system[k][i]) > Math.abs(system[pivot][i])) pivot = k;
    [system[i], system[pivot]] = [system[pivot], system[i]];
    for (let k = 0; k < size; k += 1) {
      const factor = k === i ? 0 : system[k][i] / system[i][i];
      for (let j = i; factor && j <= size; j += 1) system[k][j] -= factor * system[i][j];
    }
  }
  return system.map((row, i) => row[size] / row[i]);
}
