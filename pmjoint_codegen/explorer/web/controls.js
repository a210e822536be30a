"use strict";
// The controls: one row for a number, one group of buttons for a choice.

const GREEK = { alpha: "α", chi: "χ", rho: "ϱ", eps: "ε", xi: "ξ", lambda: "λ", theta: "θ", tau: "τ", kappa: "κ", mu: "μ", omega: "ω" };
const FACTOR = [0.5, 2]; // of the plant's own parameters
const NUMBERED = { ck: ["c", "k"] }; // gains whose number belongs to a second letter: ck1 is c with the subscript k1
const STEPS = 1000; // of a slider

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (key in made && key !== "list") made[key] = value; else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

// A name as a letter and what stands below it: c1, ck1, u_max, theta_dot; a name of words keeps them.
function partsOf(name) {
  const [, known, of] = name.match(/^(.+)_(hat|guess|low|high|prior)$/) ?? [];
  if (of) {
    const [letter, below] = partsOf(known);
    return of === "hat" ? [`${letter}\u0302`, below] : [letter, [below, of].filter(Boolean).join(" ")];
  }
  if (name.startsWith("gamma_")) return ["γ", partsOf(name.slice(6)).join("")];
  const [, base, number, word] = name.match(/^([A-Za-z]+)(?:_?(\d+)|_([A-Za-z]+\d*))?$/) ?? [null, name];
  if (word === "dot") return [`${GREEK[base] ?? base}\u0307`, ""];
  if (word && base.length > 2 && !(base in GREEK)) return [name.replaceAll("_", " "), ""];
  const [letter, before] = NUMBERED[base] ?? [GREEK[base] ?? base, ""];
  const below = number ?? (GREEK[word] ?? word ?? "");
  return below ? [letter, before + below] : [name === base ? letter : name.replaceAll("_", " "), ""];
}

// As a reader writes it: with a subscript.
function pretty(name) {
  const [letter, below] = partsOf(name);
  return below ? [letter, element("sub", {}, below)] : [letter];
}

// The same as text alone: for a canvas and for words that are read out.
function flat(name) {
  const [letter, below] = partsOf(name);
  if (letter.endsWith("\u0307")) return `d${letter.slice(0, -1)}/dt`; // small print has no room for a dot above
  if (letter.endsWith("\u0302")) return `estimate of ${flat(name.replace(/_hat$/, ""))}`;
  if (!below) return letter;
  if (below === "r") return `${letter}ᵣ`;
  return /^\d+$/.test(below) ? letter + below.replace(/\d/g, (digit) => "₀₁₂₃₄₅₆₇₈₉"[digit]) : `${letter}_${below}`;
}

// Exponents of a unit, raised.
function powers(unit) {
  return unit.replace(/\^(\d)/g, (_, digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[digit]);
}

// Where a slider stands for a value, and back: linear, or by powers around a value with its sign. A value is rounded
// below the slider's step, so that each place has its own: a key always moves it.
function scaleOf({ low, high, around, whole }) {
  if (around) {
    const span = Math.log(high / low);
    const grid = (value) => onGrid(value, (value * span) / STEPS);
    return {
      toValue: (place) => Math.sign(around) * grid(low * Math.exp((place / STEPS) * span)),
      toPlace: (value) => Math.round((Math.log(Math.abs(value) / low) / span) * STEPS),
    };
  }
  return {
    toValue: (place) => onGrid(low + (place / STEPS) * (high - low), whole ? 1 : (high - low) / STEPS),
    toPlace: (value) => Math.round(((value - low) / (high - low)) * STEPS),
  };
}

// By powers of ten around a value other than 0; linear around 0.
function spanAround(value, { factor = 10, reach = 1 } = {}) {
  if (value === 0) return { low: -reach, high: reach };
  return { low: Math.abs(value) / factor, high: Math.abs(value) * factor, around: value };
}

// Of a part of the chain of sensor, clock and actuator: none is below 0.
function linkSpan(key, value, { sample_time: period }) {
  if (["seed", "delay_samples"].includes(key)) return { low: 0, high: Math.max(10, 2 * value), whole: true };
  if (value !== 0) return spanAround(value);
  return { low: 0, high: { delay: 10 * period, jitter: 0.9 * period }[key] ?? 0.01 };
}

// Of a value of an estimate or of what it is of: its range if it has one, which it may not leave.
function spanWithin(name, all) {
  const [low, high] = ["low", "high"].map((end) => all.get(`${name}_${end}`)?.value);
  return low === undefined ? spanAround(all.get(name)?.value ?? all.get(`${name}_guess`).value) : { low, high };
}

// Of what estimates depend on: gains and leakage are not below 0, guesses stay within the range.
function adaptiveSpan({ name, value }, all) {
  if (/^gamma_|leakage$/.test(name)) return value ? spanAround(value, { factor: 100 }) : { low: 0, high: 1 };
  const [, of] = name.match(/^(.+)_(?:guess|prior)$/) ?? [];
  return of === undefined ? spanAround(value) : spanWithin(of, all);
}

// One row: item {key, name, about, unit, own, span, get, set}; `changed` is called after a change.
class Row {
  constructor(item, changed) {
    this.item = item;
    const id = `row-${item.key}`;
    const scale = scaleOf(item.span);
    this.scale = scale;
    const label = item.label ?? item.key.replaceAll("_", " ");
    this.slider = element("input", { type: "range", id, min: 0, max: STEPS, step: 1 });
    this.slider.setAttribute("aria-label", `${label}, ${item.about}`);
    this.field = element("input", { type: "number", step: "any" });
    this.field.setAttribute("aria-label", `${label}${item.unit && item.unit !== "1" ? `, in ${item.unit}` : ""}`);
    this.back = element("button", { type: "button", title: `Back to ${short(item.own)}` }, "↺");
    this.back.setAttribute("aria-label", `${label} back to ${short(item.own)}`);
    const name = element("b", {}, ...(item.title ?? pretty(item.key)));
    const about = element("span", {}, item.about);
    this.node = element("div", { className: "row" }, element("label", { htmlFor: id }, name, about), this.slider,
      element("span", { className: "number" }, this.field,
        element("span", { className: "unit" }, item.unit === "1" ? "\u00a0" : powers(item.unit))), this.back);
    this.slider.addEventListener("input", () => {
      const place = Number(this.slider.value);
      const home = place === scale.toPlace(item.own);
      this.put(home ? item.own : scale.toValue(place), changed);
    });
    this.field.addEventListener("input", () => {
      if (this.field.value !== "" && Number.isFinite(this.field.valueAsNumber)) this.put(this.field.valueAsNumber, changed);
    });
    this.field.addEventListener("change", () => this.show());
    this.back.addEventListener("click", () => {
      this.put(item.own, changed);
      this.slider.focus();
    });
  }

  put(value, changed) {
    this.item.set(value);
    this.show();
    changed();
  }

  show() {
    const value = this.item.get();
    const place = this.scale.toPlace(value);
    const stands = this.scale.toValue(Number(this.slider.value)) === value; // it is where the reader put it
    if (!stands && Number(this.slider.value) !== place) this.slider.value = Number.isFinite(place) ? place : 0;
    this.slider.setAttribute("aria-valuetext", `${short(value)} ${this.item.unit === "1" ? "" : this.item.unit}`.trim());
    if (document.activeElement !== this.field || this.field.valueAsNumber !== value) this.field.value = String(value);
    this.node.classList.toggle("changed", value !== this.item.own);
  }
}

// A choice of words, as radio buttons that look like one.
class Choice {
  constructor({ key, label, words, get, set }, changed) {
    this.get = get;
    this.inputs = Object.entries(words).map(([value, text]) => {
      const input = element("input", { type: "radio", name: key, value });
      input.addEventListener("change", () => { set(value); changed(); });
      return [input, element("label", {}, input, text)];
    });
    this.node = element("div", { className: "choices" }, ...this.inputs.map(([, node]) => node));
    this.node.setAttribute("role", "radiogroup");
    this.node.setAttribute("aria-label", label);
  }

  show() {
    for (const [input] of this.inputs) input.checked = input.value === this.get();
  }
}

function group(title, nodes, folded = false) {
  if (folded) return element("details", {}, element("summary", {}, title), element("fieldset", { ariaLabel: title }, ...nodes));
  return element("fieldset", {}, element("legend", {}, title), ...nodes);
}

// All controls of a model; `settings` gives the present ones.
function makeControls(data, settings, changed) {
  const facts = Object.values(data.variants)[0];
  const all = new Map(Object.values(data.variants).flatMap((item) => item.parameters.map((entry) => [entry.name, entry])));
  const knobs = new Map(data.knobs.map((knob) => [knob.name, knob]));
  const own = defaultSettings(data);
  const rows = [];
  const kept = (control) => { rows.push(control); return control.node; };
  const number = (entry, span = spanAround(entry.value), more = {}) => kept(new Row({
    key: entry.name, about: entry.about, unit: entry.unit, own: entry.value, span, ...more,
    get: () => settings().values[entry.name] ?? entry.value,
    set: (value) => { if (value === entry.value) delete settings().values[entry.name]; else settings().values[entry.name] = value; },
  }, changed));
  const setting = (key, about, span) => kept(new Row({
    key, about, unit: "s", own: own[key], span, get: () => settings()[key], set: (value) => { settings()[key] = value; },
  }, changed));
  const choice = (key, label, words) => kept(new Choice({ key, label, words, get: () => settings()[key], set: (value) => { settings()[key] = value; } }, changed));
  const mismatch = ([plant, name]) => kept(new Row({
    key: plant, title: [...pretty(name), " of the plant"], label: `${name} of the plant`, about: "× the controller's", unit: "1", own: 1,
    span: { low: FACTOR[0], high: FACTOR[1], around: 1 },
    get: () => settings().factors[plant] ?? 1,
    set: (value) => { if (value === 1) delete settings().factors[plant]; else settings().factors[plant] = value; },
  }, changed));

  const entries = [...all.values()];
  const named = (names) => names.filter((name) => all.has(name)).map((name) => number(all.get(name)));
  const knobRows = (turns) => data.knobs.filter((knob) => knob.turns === turns && all.has(knob.name)).map((knob) =>
    number(all.get(knob.name), knob.value ? { low: -1, high: 3 } : { low: -1, high: 1 }, { title: [knob.name.split("_").at(turns === "reference" ? -1 : 0)] }));
  const words = Object.fromEntries(saturationsOf(data).map((word) => [word, word[0].toUpperCase() + word.slice(1)]));
  const gains = entries.filter((entry) => entry.kind === "gain" && /^(c|e|ck|k|braking)\d*$/.test(entry.name));
  const links = Object.entries(facts.chain).filter(([, name]) => !facts.limits.includes(name));
  const chain = links.map(([, name]) => name);
  const adaptive = entries.filter((entry) => entry.kind === "adaptation");
  const truths = adaptive.map((entry) => entry.name.match(/^(.+)_guess$/)?.[1]).filter((name) => all.get(name)?.kind === "plant");
  const used = new Set([...gains, ...adaptive].map((entry) => entry.name).concat(truths, facts.limits, chain, [...knobs.keys()]));
  const others = entries.filter((entry) => !used.has(entry.name) && !["switch", "own"].includes(entry.kind));
  const mismatches = Object.entries(facts.own).filter(([, name]) => (all.get(name)?.value ?? 0) !== 0);
  const reach = (variable, i) => {
    const [unit, value] = [variable.unit, own.x0[i]];
    return Math.max(unit === "Pa" ? 1e5 : i === 0 ? 1 : 2, 2 * Math.abs(value));
  };

  const nodes = [
    group("Saturation", [
      ...(Object.keys(words).length > 1 ? [choice("saturation", "What the controller does about a saturated input", words)] : []),
      ...named(facts.limits),
    ]),
    group("Reference", [element("p", { className: "note" }, ...pretty("y_r"), ` = ${data.reference}`), ...knobRows("reference")]),
    group("Start", [
      ...facts.start.variables.map((variable, i) => kept(new Row({
        key: `x0_${variable.name}`, title: [...pretty(variable.name), "(0)"], label: `${variable.name} at 0`, about: variable.about, unit: variable.unit,
        own: own.x0[i], span: { low: -reach(variable, i), high: reach(variable, i) },
        get: () => settings().x0[i], set: (value) => { settings().x0[i] = value; },
      }, changed))),
      choice("start", "Start of the controller", { zero: "Filters at zero", matched: "Matched to y(0)" }),
    ]),
    group("Gains", gains.map((entry) => number(entry))),
    ...(adaptive.length ? [
      group("True values, which the controller does not know", truths.map((name) => number(all.get(name), spanWithin(name, all)))),
      group("Estimates", adaptive.map((entry) => number(entry, adaptiveSpan(entry, all))), true),
    ] : []),
    group("Load and mismatch", [...knobRows("disturbance"), ...mismatches.slice(0, 2).map(mismatch)]),
    ...(mismatches.length > 2 ? [group("More mismatch", mismatches.slice(2).map(mismatch), true)] : []),
    group("Controller", [
      choice("controller", "Kind of controller", { continuous: "Continuous", sampled: "Sampled" }),
      setting("sample_time", "of the sampled controller", spanAround(own.sample_time)),
      setting("horizon", "length of the run", { low: own.horizon / 10, high: own.horizon * 2 }),
      ...links.filter(([, name]) => all.has(name)).map(([key, name]) => number(all.get(name), linkSpan(key, all.get(name).value, own))),
    ]),
    ...(others.length ? [group("Model, as the controller and the plant know it", others.map((entry) => number(entry)), true)] : []),
  ];
  return { nodes, show: () => rows.forEach((row) => row.show()) };
}
