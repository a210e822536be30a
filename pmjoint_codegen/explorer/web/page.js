"use strict";
// The page: settings change, the loop runs, the plots follow within a frame; words and the link follow at rest.

const REST = 350; // ms without a change
const TABLE_ROWS = 21;
const COLORS = ["ink", "soft", "line", "grid", "card", "shade", "blue", "orange", "green", "purple", "grey", "ghost"];

async function main() {
  const data = JSON.parse(document.getElementById("data").textContent);
  const page = new Page(data);
  window.explorer = page; // for scripts: explorer.simulate(settings)
  await page.start();
}

class Page {
  constructor(data) {
    this.data = data;
    this.settings = fromHash(data, location.hash);
    this.engines = {};
    this.cursor = -1;
    this.frames = [];
    this.panels = panelsOf(Object.values(data.variants)[0]);
  }

  async start() {
    for (const [name, facts] of Object.entries(this.data.variants)) this.engines[name] = await Engine.make(facts);
    const controls = makeControls(this.data, () => this.settings, () => this.changed());
    this.controls = controls;
    document.getElementById("controls").replaceChildren(...controls.nodes);
    this.makePlots();
    this.law = new Law(this.data);
    this.listen();
    this.recolor();
    this.fit();
    controls.show();
    this.update();
    this.rest();
    document.documentElement.dataset.ready = "yes";
  }

  engine(settings) {
    return this.engines[settings.saturation] ?? Object.values(this.engines)[0];
  }

  // One run; throws an Error with one line where the settings allow none.
  simulate(settings) {
    return this.engine(settings).run(resolved(this.data, this.fitting(settings)));
  }

  // The model's output step, or a longer one where the horizon would hold too many rows.
  fitting(settings) {
    const most = settings.horizon / (MOST_ROWS - 1);
    return { ...settings, output_step: Math.min(Math.max(settings.output_step, most), settings.horizon) };
  }

  makePlots() {
    const place = document.getElementById("plots");
    for (const panel of this.panels) {
      const keys = panel.keys.map(([name, color, dashed]) => element("span", { className: `key${dashed ? " dashed" : ""}`, style: `--of: var(--${color})` }, ...symbolOf(name), ...(panel.units?.[name] ? [element("span", { className: "unit" }, ` [${panel.units[name]}]`)] : [])));
      const unit = panel.plane ? [...symbolOf(panel.plane[1]), ` [${panel.units[1]}] over `, ...symbolOf(panel.plane[0]), ` [${panel.units[0]}]`] : panel.unit === "log" ? ["logarithmic"] : panel.unit ? [`[${panel.unit}]`] : [];
      panel.canvas = element("canvas", { tabIndex: 0, id: `plot-${panel.id}` });
      panel.canvas.setAttribute("role", "img");
      panel.output = element("output", {});
      panel.output.setAttribute("aria-live", "off");
      const caption = element("figcaption", {}, element("span", { className: "title" }, panel.title), element("span", { className: "unit" }, ...unit), ...keys, panel.output);
      place.append(element("figure", {}, caption, panel.canvas));
      panel.plot = new Plot(panel.canvas);
    }
  }

  listen() {
    const on = (id, action) => document.getElementById(id).addEventListener("click", action);
    on("reset", () => { this.settings = defaultSettings(this.data); this.controls.show(); this.changed(); });
    on("keep", (event) => this.keep(event.currentTarget));
    on("copy-link", (event) => this.copy(event.currentTarget, location.href));
    on("copy-command", (event) => this.copy(event.currentTarget, commandLine(this.data, this.fitting(this.settings))));
    document.getElementById("table").addEventListener("toggle", () => this.table());
    window.addEventListener("hashchange", () => {
      if (location.hash === toHash(this.data, this.settings)) return;
      this.settings = fromHash(this.data, location.hash);
      this.controls.show();
      this.changed();
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this.recolor(); this.draw(); });
    new ResizeObserver(() => { this.fit(); this.draw(); }).observe(document.getElementById("plots"));
    for (const panel of this.panels) {
      const { canvas } = panel;
      canvas.addEventListener("pointermove", (event) => this.point(panel.plot.rowAt(event.clientX, this.run?.t ?? [])));
      canvas.addEventListener("pointerleave", () => this.point(-1));
      canvas.addEventListener("blur", () => this.point(-1));
      canvas.addEventListener("keydown", (event) => this.key(event));
    }
  }

  key(event) {
    const last = (this.run?.rows ?? 1) - 1;
    const step = Math.max(1, Math.round(last / (event.shiftKey ? 10 : 100)));
    const from = this.cursor < 0 ? 0 : this.cursor;
    const to = { ArrowRight: from + step, ArrowLeft: from - step, Home: 0, End: last, Escape: -1 }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    this.point(event.key === "Escape" ? -1 : Math.min(Math.max(to, 0), last));
    this.say(this.cursor < 0 ? "" : this.reading());
  }

  point(row) {
    if (row === this.cursor) return;
    this.cursor = row;
    this.schedule(false);
  }

  keep(button) {
    this.kept = this.kept ? null : this.run;
    button.setAttribute("aria-pressed", String(Boolean(this.kept)));
    button.textContent = this.kept ? "Drop comparison" : "Keep to compare";
    this.schedule(false);
  }

  async copy(button, text) {
    const label = button.dataset.label ?? (button.dataset.label = button.textContent);
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "Copied";
    } catch {
      window.prompt("Copy:", text); // a page from disk may have no clipboard
    }
    setTimeout(() => { button.textContent = label; }, 1200);
  }

  changed() {
    this.schedule(true);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.rest(), REST);
  }

  // At most one run and one drawing in a frame.
  schedule(stale) {
    this.stale = this.stale || stale;
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      if (this.stale) this.update(); else this.draw();
    });
  }

  update() {
    const begun = performance.now();
    this.stale = false;
    const alert = document.getElementById("alert");
    try {
      const run = this.simulate(this.settings);
      run.columns = { V: run.V };
      const { plane } = this.panels.at(-1);
      for (const name of ["y", "y_r", "e", "v", "u", "r1", ...(plane ?? [])]) run.columns[name] = run.column(name);
      if (this.engine(this.settings).facts.rho > 1) run.columns.r2 = run.column("r2");
      run.peakV = run.peak("v");
      run.peakE = run.peak("e");
      run.limits = limitsOf(this.engine(this.settings).facts, run.values);
      this.run = run;
      alert.hidden = run.status === 1;
      alert.textContent = run.status === 1 ? "" : `The run ${run.message}.`;
      document.body.classList.remove("lost");
    } catch (error) {
      alert.hidden = false;
      alert.textContent = error.message;
      document.body.classList.add("lost");
      return;
    }
    const computed = performance.now();
    this.draw();
    this.summary();
    this.law.show(this.engine(this.settings), this.run.values);
    this.frames.push([computed - begun, performance.now() - begun]);
    if (this.frames.length > 60) this.frames.shift();
  }

  draw() {
    if (!this.run) return;
    for (const panel of this.panels) {
      const spec = panel.build(this.run, this.kept, this.colors, panel);
      panel.plot.draw(spec, this.colors, this.cursor);
      const known = this.cursor >= 0 && this.cursor < this.run.rows;
      const values = known ? spec.series.filter((item) => !item.ghost && item.name && !spec.plane).map((item) => `${item.name} ${short(item.y[this.cursor])}`) : [];
      panel.output.textContent = known && !spec.plane ? `t ${short(this.run.t[this.cursor])} s · ${values.join(" · ")}` : "";
    }
  }

  summary() {
    const { run } = this;
    const unit = this.panels[0].unit;
    const [inUnit, ofV] = [unit, this.panels[2].unit];
    const entries = [
      ["largest |e|", short(run.peakE[0]), inUnit],
      ["final e", short(run.column("e")[run.rows - 1]), inUnit],
      ["settled (2 %)", run.settling === null ? "–" : run.settling >= run.settings.horizon ? "not yet" : short(run.settling), run.settling === null || run.settling >= run.settings.horizon ? "" : "s"],
      ["∫ e² dt", short(run.ise), ""],
      ["largest |v|", short(run.peakV[0]), ofV],
      ["saturated", short(run.saturated), "s"],
      ["switches", String(run.switches.length), ""],
      ["steps", String(run.steps), ""],
    ];
    const place = document.getElementById("summary");
    if (!place.children.length) place.append(...entries.map(([name]) => element("div", {}, element("dt", {}, name), element("dd", {}, "", element("small", {})))));
    entries.forEach(([, value, after], i) => {
      const [text, small] = place.children[i].lastChild.childNodes;
      text.data !== undefined ? (text.data = value) : place.children[i].lastChild.prepend(value);
      (small ?? text).textContent = after ? ` ${after}` : "";
    });
  }

  // What need not follow every frame: the link, the command, descriptions, the table.
  rest() {
    history.replaceState(null, "", toHash(this.data, this.settings) || location.pathname + location.search);
    document.getElementById("command").textContent = commandLine(this.data, this.fitting(this.settings));
    if (!this.run) return;
    this.describe();
    this.table();
    const [computed, whole] = [0, 1].map((i) => median(this.frames.map((frame) => frame[i])));
    document.getElementById("timing").textContent = `A run takes ${computed.toFixed(1)} ms, with its plots ${whole.toFixed(1)} ms.`;
    this.say(document.getElementById("alert").textContent || `The run ${this.run.message}. Largest error ${short(this.run.peakE[0])}, largest v ${short(this.run.peakV[0])}, saturated for ${short(this.run.saturated)} seconds.`);
  }

  describe() {
    for (const panel of this.panels) {
      const parts = panel.plot.spec.series.filter((item) => !item.ghost && item.name).map((item) => {
        const [low, high] = [Math.min(...item.y), Math.max(...item.y)];
        return `${item.name} from ${short(low)} to ${short(high)}, last ${short(item.y.at(-1))}`;
      });
      panel.canvas.setAttribute("aria-label", `${panel.title}: ${parts.join("; ")}. Arrow keys read values.`);
    }
  }

  reading() {
    const { columns, t } = this.run;
    const of = (name) => `${name} ${short(columns[name][this.cursor])}`;
    return `t ${short(t[this.cursor])} s: ${["y", "y_r", "e", "v", "u", "r1", "V"].map(of).join(", ")}`;
  }

  say(text) {
    const place = document.getElementById("spoken");
    if (place.textContent !== text) place.textContent = text;
  }

  table() {
    if (!document.getElementById("table").open || !this.run) return;
    const names = ["t", ...Object.keys(this.run.columns)];
    const columns = { ...this.run.columns, t: this.run.t };
    const count = Math.min(TABLE_ROWS, this.run.rows);
    const rows = Array.from({ length: count }, (_, i) => Math.round((i * (this.run.rows - 1)) / Math.max(1, count - 1)));
    const head = element("tr", {}, ...names.map((name) => element("th", { scope: "col" }, ...symbolOf(name))));
    const body = rows.map((row) => element("tr", {}, ...names.map((name) => element("td", {}, short(columns[name][row], 6)))));
    document.getElementById("rows").replaceChildren(element("table", {}, element("thead", {}, head), element("tbody", {}, ...body)));
  }

  recolor() {
    const style = getComputedStyle(document.documentElement);
    this.colors = Object.fromEntries(COLORS.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  }

  fit() {
    for (const panel of this.panels) panel.plot.resize();
  }
}

function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted.length ? sorted[sorted.length >> 1] : 0;
}

function symbolOf(name) {
  return name === "y_r" ? ["y", element("sub", {}, "r")] : pretty(name);
}

function limitsOf(facts, values) {
  const [low, high] = facts.limits.length > 1 ? facts.limits.map((name) => values[name]) : [-values[facts.limit], values[facts.limit]];
  return [low, high];
}

// The equations, once as they are and once with the numbers of the present run.
class Law {
  constructor(data) {
    this.data = data;
  }

  build(facts) {
    if (this.facts === facts) return;
    this.facts = facts;
    this.places = [];
    const whole = facts.law.filter((item) => item.main);
    document.getElementById("law").replaceChildren(...whole.map((item) => this.entry(item)));
    document.getElementById("rest").replaceChildren(...facts.law.filter((item) => !item.main).map((item) => this.entry(item)));
  }

  entry(item) {
    const [symbols, numbers] = [0, 1].map(() => element("div", { className: "scroll", innerHTML: item.math }));
    numbers.classList.add("now");
    for (const node of numbers.querySelectorAll("[data-p]")) {
      const number = document.createElementNS("http://www.w3.org/1998/Math/MathML", "mn");
      node.replaceChildren(number);
      this.places.push([number, node.dataset.p, ""]);
    }
    const parts = numbers.querySelector("[data-p]") ? [symbols, numbers] : [symbols];
    const about = element("div", { className: "of" }, item.meaning);
    return element("div", { className: "equation" }, element("span", { className: "of" }, item.number), element("div", {}, about, ...parts));
  }

  show(engine, values) {
    this.build(engine.facts);
    const numbers = engine.numbers(values);
    for (const place of this.places) {
      const value = numbers[place[1]];
      const text = value < 0 ? `(${short(value)})` : short(value);
      if (text !== place[2]) {
        place[0].textContent = text;
        place[2] = text;
      }
    }
  }
}

main();
