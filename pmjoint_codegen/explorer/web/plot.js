"use strict";
// Line plots on a canvas.

const MARGIN = { left: 64, narrow: 54, right: 12, second: 58, top: 8, bottom: 36 };
const NARROW = 340; // px
const FONT = "11px system-ui, sans-serif";

// Round steps that divide a range into about `count` parts, and the numbers on them.
function ticksOf(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].find((size) => size * power >= rough) * power;
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i += 1) found.push(i * step);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return found.map((value) => [value, Math.abs(value) >= 1e5 || (digits > 4) ? short(value, 2) : value.toFixed(digits).replace("-", "−")]);
}

function decadesOf(low, high) {
  const [first, last] = [Math.ceil(low - 1e-9), Math.floor(high + 1e-9)];
  const step = Math.max(1, Math.ceil((last - first) / 5));
  const found = [];
  for (let k = first; k <= last; k += step) found.push([k, `10${superscript(k)}`]);
  return found;
}

function superscript(k) {
  return String(k).replace(/./g, (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);
}

// The range of several arrays with some room; [lower, upper] of `within` bounds it.
function rangeOf(arrays, within) {
  let [low, high] = [Infinity, -Infinity];
  for (const array of arrays) {
    for (let i = 0; i < array.length; i += 1) {
      const value = array[i];
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(low <= high)) [low, high] = [-1, 1];
  if (within) [low, high] = [Math.max(low, within[0]), Math.min(high, within[1])];
  const size = high - low;
  const tiny = Math.max(Math.abs(low), Math.abs(high)) * 1e-6 || 1;
  const room = size > tiny ? 0.06 * size : tiny;
  return [low - room, high + room];
}

class Plot {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.resize();
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
  }

  // spec: series [{x, y, color, width, dash, right}], x and y ranges, log, lines, spans, note, labels {x, y, right},
  // zero (every series is exactly 0: there is no scale to show); see panels.js.
  draw(spec, colors, cursor) {
    const { context: c, width, height } = this;
    const right = spec.right ? MARGIN.second : MARGIN.right;
    const left = width < NARROW ? MARGIN.narrow : MARGIN.left;
    const box = { x: left, y: MARGIN.top, w: width - left - right, h: height - MARGIN.top - MARGIN.bottom };
    const toX = (value) => box.x + ((value - spec.x[0]) / (spec.x[1] - spec.x[0])) * box.w;
    const scale = (range) => (value) => box.y + box.h - ((value - range[0]) / (range[1] - range[0])) * box.h;
    const [toY, toRight] = [scale(spec.y), scale(spec.right ?? spec.y)];
    Object.assign(this, { spec, box, toX, toY });
    c.clearRect(0, 0, width, height);
    c.font = FONT;
    this.spans(spec.spans ?? [], box, toX, colors);
    this.axes(spec, box, toX, toY, toRight, colors);
    c.save();
    c.beginPath();
    c.rect(box.x, box.y, box.w, box.h);
    c.clip();
    for (const [value, color] of spec.lines ?? []) this.line([[box.x, toY(value)], [box.x + box.w, toY(value)]], color, 1, [2, 3]);
    for (const series of spec.series) this.curve(series, toX, series.right ? toRight : toY, spec.log && !series.right);
    for (const [x, y, color, hollow] of spec.points ?? []) this.dot(toX(x), toY(y), color, hollow, colors);
    if (cursor >= 0) this.cursor(spec, cursor, box, toX, toY, toRight, colors);
    c.restore();
    if (spec.note) this.note(spec.note, box, colors);
  }

  spans(spans, box, toX, colors) {
    this.context.fillStyle = colors.shade;
    for (const [from, to] of spans) this.context.fillRect(toX(from), box.y, Math.max(1, toX(to) - toX(from)), box.h);
  }

  axes(spec, box, toX, toY, toRight, colors) {
    const c = this.context;
    c.lineWidth = 1;
    c.strokeStyle = colors.grid;
    c.fillStyle = colors.soft;
    c.setLineDash([]);
    c.textAlign = "right";
    c.textBaseline = "middle";
    const vertical = spec.zero ? [[0, "0"]] : spec.log ? decadesOf(...spec.y) : ticksOf(...spec.y, box.h / 34);
    for (const [value, text] of vertical) {
      const y = Math.round(toY(value)) + 0.5;
      this.segment(box.x, y, box.x + box.w, y);
      c.fillText(text, box.x - 6, y);
    }
    c.textAlign = "center";
    c.textBaseline = "top";
    for (const [value, text] of ticksOf(...spec.x, box.w / 70)) {
      const x = Math.round(toX(value)) + 0.5;
      this.segment(x, box.y, x, box.y + box.h);
      c.fillText(text, Math.min(x, this.width - 9), box.y + box.h + 6);
    }
    if (spec.right) {
      c.textAlign = "left";
      c.textBaseline = "middle";
      c.fillStyle = spec.rightColor;
      const second = spec.zero ? [[0, "0"]] : ticksOf(...spec.right, box.h / 34);
      for (const [value, text] of second) c.fillText(text, box.x + box.w + 6, toRight(value));
    }
    this.labels(spec, box, colors);
    c.strokeStyle = colors.line;
    c.strokeRect(box.x + 0.5, box.y + 0.5, box.w, box.h);
  }

  // What the axes show, with units.
  labels({ labels, rightColor }, box, colors) {
    const c = this.context;
    c.fillStyle = colors.soft;
    c.textAlign = "center";
    c.textBaseline = "bottom";
    c.fillText(labels.x, box.x + box.w / 2, this.height - 1);
    for (const [text, x, color] of [[labels.y, 12, colors.soft], [labels.right ?? "", this.width - 2, rightColor]]) {
      c.save();
      c.translate(x, box.y + box.h / 2);
      c.rotate(-Math.PI / 2);
      c.fillStyle = color ?? colors.soft;
      c.fillText(text, 0, 0);
      c.restore();
    }
  }

  segment(x1, y1, x2, y2) {
    this.context.beginPath();
    this.context.moveTo(x1, y1);
    this.context.lineTo(x2, y2);
    this.context.stroke();
  }

  line(points, color, width, dash) {
    const c = this.context;
    c.strokeStyle = color;
    c.lineWidth = width;
    c.setLineDash(dash ?? []);
    c.beginPath();
    points.forEach(([x, y], i) => (i ? c.lineTo(x, y) : c.moveTo(x, y)));
    c.stroke();
    c.setLineDash([]);
  }

  curve({ x, y, color, width = 1.7, dash }, toX, toY, log) {
    const c = this.context;
    c.strokeStyle = color;
    c.lineWidth = width;
    c.lineJoin = "round";
    c.setLineDash(dash ?? []);
    c.beginPath();
    for (let i = 0; i < x.length; i += 1) c.lineTo(toX(x[i]), toY(log ? Math.log10(Math.max(y[i], 1e-300)) : y[i]));
    c.stroke();
    c.setLineDash([]);
  }

  dot(x, y, color, hollow, colors) {
    const c = this.context;
    c.beginPath();
    c.arc(x, y, 4, 0, 2 * Math.PI);
    c.fillStyle = hollow ? colors.card : color;
    c.strokeStyle = color;
    c.lineWidth = 1.6;
    c.fill();
    c.stroke();
  }

  cursor(spec, cursor, box, toX, toY, toRight, colors) {
    const x = spec.series.at(-1).x[cursor];
    if (!spec.plane && x !== undefined) this.line([[toX(x), box.y], [toX(x), box.y + box.h]], colors.soft, 1);
    for (const series of spec.series) {
      if (series.ghost || cursor >= series.x.length) continue;
      const value = spec.log && !series.right ? Math.log10(Math.max(series.y[cursor], 1e-300)) : series.y[cursor];
      this.dot(toX(series.x[cursor]), (series.right ? toRight : toY)(value), series.color, false, colors);
    }
  }

  note(text, box, colors) {
    const c = this.context;
    c.fillStyle = colors.soft;
    c.textAlign = "right";
    c.textBaseline = "top";
    const width = Math.min(c.measureText(text).width, box.w - 12);
    c.globalAlpha = 0.85;
    c.fillStyle = colors.card;
    c.fillRect(box.x + box.w - width - 12, box.y + 4, width + 8, 16);
    c.globalAlpha = 1;
    c.fillStyle = colors.soft;
    c.fillText(text, box.x + box.w - 8, box.y + 6, width);
  }

  // The row nearest to a position of the pointer; -1 outside the axes.
  rowAt(clientX, clientY, t) {
    const { left, top } = this.canvas.getBoundingClientRect();
    const [x, y, box] = [clientX - left, clientY - top, this.box];
    if (!box || x < box.x - 4 || x > box.x + box.w + 4) return -1;
    return this.spec.plane ? this.rowNear(x, y) : this.rowIn(x, t);
  }

  rowNear(x, y) {
    const series = this.spec.series.at(-1);
    let [best, row] = [Infinity, -1];
    for (let i = 0; i < series.x.length; i += 1) {
      const apart = (this.toX(series.x[i]) - x) ** 2 + (this.toY(series.y[i]) - y) ** 2;
      if (apart < best) [best, row] = [apart, i];
    }
    return row;
  }

  rowIn(x, t) {
    const { box, spec } = this;
    const instant = spec.x[0] + ((x - box.x) / box.w) * (spec.x[1] - spec.x[0]);
    let [low, high] = [0, t.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (t[middle] <= instant) low = middle; else high = middle;
    }
    return instant - t[low] < t[high] - instant ? low : high;
  }
}
