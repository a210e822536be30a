"use strict";
// Numbers: exact units, expressions of parameters, the rules of a design, and text.

// A number in a model file's unit, in SI units, rounded once: as pmjoint_codegen.values.to_si.
function toSI(value, scale) {
  if (scale === "1" || !Number.isFinite(value)) return value;
  const [a, b] = [decimal(String(value)), decimal(scale)];
  return Number(`${a.digits * b.digits}e${a.exponent + b.exponent}`);
}

function decimal(text) {
  const [mantissa, exponent = "0"] = text.toLowerCase().split("e");
  const [whole, part = ""] = mantissa.split(".");
  return { digits: BigInt(whole + part), exponent: Number(exponent) - part.length };
}

// The value of a tree such as ["+", "c1", 2] at numbers by name.
function evaluate(tree, values) {
  if (typeof tree === "number") return tree;
  if (typeof tree === "string") return tree === "pi" && !(tree in values) ? Math.PI : values[tree];
  const [operation, ...parts] = tree;
  const [a, b] = parts.map((part) => evaluate(part, values));
  switch (operation) {
    case "+": return a + b;
    case "-": return a - b;
    case "*": return a * b;
    case "/": return a / b;
    case "**": return a ** b;
    default: return Math[operation](a);
  }
}

// Whether all roots of a polynomial, highest power first, lie in the open left half plane (Routh).
function isHurwitz(coefficients) {
  const sign = Math.sign(coefficients[0]);
  if (!sign) return false;
  const all = coefficients.map((entry) => entry * sign);
  let [upper, lower] = [0, 1].map((parity) => all.filter((_, i) => i % 2 === parity));
  while (lower.length) {
    if (!(lower[0] > 0)) return false;
    const factor = upper[0] / lower[0];
    const row = upper.slice(1).map((entry, i) => entry - factor * (lower[i + 1] ?? 0));
    [upper, lower] = [lower, row];
  }
  return true;
}

const RULES = {
  finite: () => true,
  positive: (terms) => terms.every((term) => term > 0),
  nonnegative: (terms) => terms.every((term) => term >= 0),
  whole: (terms) => terms.every((term) => term >= 0 && term <= 2 ** 53 && Number.isInteger(term)),
  nonzero: (terms) => terms.every((term) => term !== 0),
  zero: (terms) => terms.every((term) => term === 0),
  hurwitz: isHurwitz,
};

// The first rule that values break, as one line; empty if there is none.
function complaint(facts, values) {
  for (const [name, value] of Object.entries(values)) {
    if (!Number.isFinite(value)) return `${name} is not a finite number`;
  }
  const positive = [...facts.positive, "input_scale", ...facts.limits.filter((name) => name === facts.limit)];
  const wrong = positive.find((name) => !(values[name] > 0));
  if (wrong) return `${wrong} is ${short(values[wrong])}; allowed: a number greater than 0`;
  if (!isHurwitz([1, ...facts.filters.map((name) => values[name])])) {
    return `gains ${facts.filters.join(", ")} leave the filters unstable; allowed: A0 = A - k e1' Hurwitz`;
  }
  for (const rule of facts.rules) {
    if (!obeyed(rule, values)) {
      return `${rule.name}: ${rule.what || short(evaluate(rule.terms[0], values))}; allowed: ${rule.allowed}`;
    }
  }
  return "";
}

function obeyed(rule, values) {
  const terms = rule.terms.map((term) => evaluate(term, values));
  return terms.every(Number.isFinite) && RULES[rule.kind](terms);
}

// Few digits for a reader: 0.0123, 12.3, 1.23e5, with a true minus sign.
function short(value, digits = 4) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text = size >= 1e5 || size < 1e-3 ? value.toExponential(digits - 1) : value.toPrecision(digits);
  return trimmed(text).replace(/-/g, "−");
}

function trimmed(text) {
  return text.replace(/(\.\d*?)0+(?=e|$)/, "$1").replace(/\.(?=e|$)/, "").replace("e+", "e");
}

// A number with as many digits as a slider sets, and no more.
function rounded(value, digits = 3) {
  return Number(value.toPrecision(digits));
}

// The nearest number with no more decimals than a step needs: 15.07 for a step of 0.07.
function onGrid(value, step) {
  const unit = 10 ** Math.floor(Math.log10(Math.abs(step)));
  return Number((Math.round(value / unit) * unit).toPrecision(12)) + 0;
}
