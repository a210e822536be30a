"use strict";
// The actuator's saturation modes (10): as pmjoint_codegen/loops/modes.py, in the same arithmetic.

// limits: rows of offset, slope, lower, upper; valve: {zone, own, lower, upper} or null.
function makeActuator(limits, valve) {
  const points = valve ? valvePoints(valve) : [];
  const reached = new Set([...points, ...thresholdsOf(limits[0])]);
  for (const [low, high] of spans(points)) {
    for (const channel of limits.slice(1)) {
      for (const value of thresholdsOf(behind(channel, valve, low, high))) {
        if (low < value && value < high) reached.add(value);
      }
    }
  }
  const thresholds = [...reached].sort((a, b) => a - b);
  const intervals = spans(thresholds);
  return {
    thresholds,
    modes: intervals.map(([low, high]) =>
      limits.flatMap((channel, j) => affine(j ? behind(channel, valve, low, high) : channel, low, high))),
    labels: intervals.map(([low, high]) => sideOf(limits[0], low, high)),
  };
}

function spans(points) {
  const all = [-Infinity, ...points, Infinity];
  return all.slice(1).map((high, i) => [all[i], high]);
}

function valvePoints({ zone, own, lower, upper }) {
  const more = own - zone;
  const right = [more, upper - zone].filter((value) => value > 0);
  const left = [-more, lower + zone].filter((value) => value < 0);
  return [...new Set([0, ...right, ...left])].sort((a, b) => a - b);
}

function behind(channel, valve, low, high) {
  if (!valve) return channel;
  const [offset, slope, lower, upper] = channel;
  const [before, gain] = through(valve, low, high);
  return [offset + slope * before, slope * gain, lower, upper];
}

function through({ zone, own, lower, upper }, low, high) {
  const more = own - zone;
  if (low >= 0) {
    if (low >= upper - zone) return [Math.max(upper - own, 0), 0];
    return low >= more ? [-more, 1] : [0, 0];
  }
  if (high <= lower + zone) return [Math.min(lower + own, 0), 0];
  return high <= -more ? [more, 1] : [0, 0];
}

function thresholdsOf([offset, slope, lower, upper]) {
  if (slope === 0) return [];
  return [lower, upper].map((limit) => (limit - offset) / slope + 0).filter(Number.isFinite);
}

function sideOf([offset, slope, lower, upper], low, high) {
  if (slope === 0) return Number(offset > upper) - Number(offset < lower);
  const rising = slope > 0 ? 1 : -1;
  const [atLower, atUpper] = [(lower - offset) / slope, (upper - offset) / slope].sort((a, b) => a - b);
  if (high <= atLower) return -rising;
  return low >= atUpper ? rising : 0;
}

function affine(channel, low, high) {
  const [offset, slope, lower, upper] = channel;
  return { "-1": [lower, 0], 0: [offset, slope], 1: [upper, 0] }[sideOf(channel, low, high)];
}
