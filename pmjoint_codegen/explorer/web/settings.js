"use strict";
// Settings of a run: the model's own, their text in a link, and the command line that makes the same run.

function defaultSettings(data) {
  const [saturation] = Object.keys(data.variants);
  const facts = data.variants[saturation];
  const off = facts.parameters.find((item) => item.name === "compensator").value === 0;
  const { x0, horizon, output_step, sample_time, start, controller } = facts.simulation;
  return {
    values: {}, // parameter -> number in the model file's unit, where it is not the model's own
    factors: {}, // the plant's own -> multiple of the controller's value
    x0: [...x0],
    saturation: off ? "clip" : saturation,
    controller,
    start,
    sample_time,
    horizon,
    output_step,
  };
}

// What may be done about a saturated input: each compensator, and plain clipping where the model does not refuse it.
function saturationsOf(data) {
  const [facts] = Object.values(data.variants);
  const clips = facts.rules.every((rule) => rule.name !== "compensator" || obeyed(rule, { compensator: 0 }));
  return [...["compensator", "braking"].filter((word) => word in data.variants), ...(clips ? ["clip"] : [])];
}

// The kernels that a kind of saturation needs: plain clipping is a switch of any.
function factsFor(data, saturation) {
  return data.variants[saturation] ?? Object.values(data.variants)[0];
}

// Settings as a run takes them: multiples become numbers.
function resolved(data, settings) {
  const facts = factsFor(data, settings.saturation);
  const values = { ...settings.values };
  for (const [own, factor] of Object.entries(settings.factors)) {
    const name = facts.own[own];
    if (name !== undefined && factor !== 1) values[own] = rounded(factor * valueOf(facts, settings, name), 12);
  }
  return { ...settings, values };
}

function valueOf(facts, settings, name) {
  return settings.values[name] ?? facts.parameters.find((item) => item.name === name)?.value;
}

const WORDS = ["saturation", "controller", "start"];
const NUMBERS = ["sample_time", "horizon"];

// What a link says of its model: its name and the first digits of its hash.
function linkName(data) {
  const [facts] = Object.values(data.variants);
  return `${data.name}-${facts.hash.slice(0, 8)}`;
}

function toHash(data, settings) {
  const own = defaultSettings(data);
  const pairs = [];
  for (const key of [...WORDS, ...NUMBERS]) if (settings[key] !== own[key]) pairs.push([key, settings[key]]);
  if (String(settings.x0) !== String(own.x0)) pairs.push(["x0", settings.x0.join(",")]);
  for (const [name, value] of Object.entries(settings.values)) pairs.push([`p.${name}`, value]);
  for (const [name, factor] of Object.entries(settings.factors)) pairs.push([`f.${name}`, factor]);
  return pairs.length ? `#${new URLSearchParams([["model", linkName(data)], ...pairs])}` : "";
}

// Settings from a link, and one line about what of it was refused. A link that names another model sets nothing.
function fromHash(data, hash) {
  const settings = defaultSettings(data);
  const pairs = [...new URLSearchParams(hash.replace(/^#/, ""))];
  const [, model] = pairs.find(([key]) => key === "model") ?? [];
  if (model !== undefined && model !== linkName(data)) {
    return { settings, notice: `The link is for ${model}; this page has ${linkName(data)}. It shows the model's own settings.` };
  }
  const refused = pairs.filter(([key, text]) => key !== "model" && !taken(data, settings, key, text));
  const names = refused.map(([key, text]) => `${key}=${text}`.slice(0, 60)).join(", ");
  return { settings, notice: refused.length ? `Not understood in the link, and left out: ${names}.` : "" };
}

// Put one pair of a link into the settings; whether the model knows it.
function taken(data, settings, key, text) {
  const facts = Object.values(data.variants);
  const offered = { saturation: saturationsOf(data), controller: ["continuous", "sampled"],
    start: ["zero", "matched"] };
  const [kind, name] = [key.slice(0, 2), key.slice(2)];
  const numbers = text.split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
  if (WORDS.includes(key)) {
    if (!offered[key].includes(text)) return false;
    settings[key] = text;
    return true;
  }
  if (!numbers.every(Number.isFinite) || numbers.length !== (key === "x0" ? settings.x0.length : 1)) return false;
  if (key === "x0") settings.x0 = numbers;
  else if (NUMBERS.includes(key) && numbers[0] > 0) settings[key] = numbers[0];
  else if (kind === "p." && facts.some((item) => item.parameters.some((entry) => entry.name === name))) {
    settings.values[name] = numbers[0];
  } else if (kind === "f." && facts.some((item) => Object.hasOwn(item.own, name))) settings.factors[name] = numbers[0];
  else return false;
  return true;
}

function commandLine(data, settings) {
  const own = defaultSettings(data);
  const knobs = new Map(data.knobs.map((knob) => [knob.name, knob]));
  const { values } = resolved(data, settings);
  const words = ["pmjoint", "simulate", quoted(data.called)];
  for (const [name, value] of Object.entries(values)) if (!knobs.has(name)) words.push("--set", `${name}=${value}`);
  for (const [option, patterns] of Object.entries(data.patterns)) {
    const turned = data.knobs.some((knob) => knob.turns === option && (values[knob.name] ?? knob.value) !== knob.value);
    if (!turned) continue;
    for (const pattern of patterns) {
      const text = pattern.replace(/[A-Za-z_]\w*/g, (name) => (knobs.has(name) ? `(${values[name] ?? knobs.get(name).value})` : name));
      words.push(`--${option}`, quoted(text));
    }
  }
  if (String(settings.x0) !== String(own.x0)) words.push(`--x0=${settings.x0.join(",")}`);
  for (const key of [...WORDS, ...NUMBERS]) {
    if (settings[key] !== own[key]) words.push(`--${key.replace("_", "-")}`, String(settings[key]));
  }
  if (settings.output_step !== own.output_step) words.push("--output-step", String(settings.output_step));
  return words.join(" ");
}

function quoted(text) {
  return /^[\w./=-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;
}
