"use strict";
// The page: settings change, the loop runs, the plots follow within a frame; words and the link follow at rest.

const REST = 350; // ms without a change
const TABLE_ROWS = 21;
const COLORS = ["ink", "soft", "line", "grid", "card", "shade", "blue", "orange", "green", "purple", "grey", "ghost"];

async function main() {
  const data = JSON.parse(document.getElementById("data").textContent);
  const page = new Page(data);
  window.explorer = page; // for scripts: explorer.simulate(settings)
  await page.start().catch((error) => { // an old browser, or one that forbids WebAssembly
    page.alert(`The page cannot run here: ${error.message}`);
    throw error;
  });
}

class Page {
  constructor(data) {
    this.data = data;
    this.engines = {};
    this.cursor = -1;
    this.frames = [];
    const [facts] = Object.values(data.variants);
    this.panels = panelsOf(facts);
    const known = new Map([...facts.signals, ...facts.states].map((item) => [item.name, item.unit]));
    const of = (name) => powers(name === "V" ? squared(known.get("y")) : known.get(name) ?? "1");
    this.units = { y: of("y"), u: of("u"), of };
    this.follow();
  }

  // Take the settings of the address, and say what of it was refused.
  follow() {
    const { settings, notice } = fromHash(this.data, location.hash);
    this.settings = settings;
    this.notice(notice);
  }

  alert(text) {
    const place = document.getElementById("alert");
    place.hidden = !text;
    if (place.textContent !== text) place.textContent = text;
  }

  notice(text, more = []) {
    const place = document.getElementById("notice");
    place.hidden = !text;
    place.replaceChildren(text, ...more);
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
    this.first = performance.now(); // ms from the start of the navigation to the first plots
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
      const shaded = panel.shaded ? [element("span", { className: "key shaded" }, "u at a limit")] : [];
      const keys = panel.keys.map(([name, color, dashed]) => element("span", { className: `key${dashed ? " dashed" : ""}`, style: `--of: var(--${color})` }, ...pretty(name)));
      panel.names = [...panel.keys.map(([name]) => name), ...(panel.plane ?? [])];
      panel.canvas = element("canvas", { tabIndex: 0, id: `plot-${panel.id}` });
      panel.canvas.setAttribute("role", "img");
      panel.canvas.setAttribute("aria-label", panel.title);
      panel.output = element("output", {});
      panel.output.setAttribute("aria-live", "off");
      if (panel.truth) keys.push(element("span", { className: "key dashed", style: "--of: var(--orange)" }, panel.truth));
      const caption = element("figcaption", {}, element("span", { className: "title" }, panel.title), ...keys, ...shaded);
      panel.figure = element("figure", {}, caption, element("div", { className: "plot" }, panel.canvas, panel.output));
      place.append(panel.figure);
      panel.plot = new Plot(panel.canvas);
    }
  }

  listen() {
    const on = (id, action) => document.getElementById(id).addEventListener("click", action);
    on("reset", () => { this.settings = defaultSettings(this.data); this.controls.show(); this.changed(); this.say("The model's own settings."); });
    on("keep", (event) => this.keep(event.currentTarget));
    on("copy-link", (event) => this.copy(event.currentTarget, this.address()));
    on("copy-command", (event) => this.copy(event.currentTarget, commandLine(this.data, this.fitting(this.settings))));
    document.getElementById("table").addEventListener("toggle", () => this.table());
    window.addEventListener("hashchange", () => {
      if (location.hash === toHash(this.data, this.settings)) return;
      this.follow();
      this.controls.show();
      this.schedule(true);
    });
    for (const query of ["(prefers-color-scheme: dark)", "(forced-colors: active)"]) {
      matchMedia(query).addEventListener("change", () => { this.recolor(); this.draw(); });
    }
    new ResizeObserver(() => { this.fit(); this.draw(); }).observe(document.getElementById("plots"));
    for (const panel of this.panels) {
      const { canvas } = panel;
      for (const kind of ["pointerdown", "pointermove"]) {
        canvas.addEventListener(kind, (event) => this.point(panel.plot.rowAt(event.clientX, event.clientY, this.run?.t ?? [])));
      }
      canvas.addEventListener("pointerleave", () => this.point(-1));
      canvas.addEventListener("blur", () => this.point(-1));
      canvas.addEventListener("keydown", (event) => this.key(event, panel));
    }
  }

  key(event, panel) {
    const last = (this.run?.rows ?? 1) - 1;
    const step = Math.max(1, Math.round(last / (event.shiftKey ? 10 : 100)));
    const from = this.cursor < 0 ? 0 : this.cursor;
    const leap = Math.max(1, Math.round(last / 10));
    const to = { ArrowRight: from + step, ArrowLeft: from - step, PageUp: from + leap, PageDown: from - leap, Home: 0, End: last, Escape: -1 }[event.key];
    if (to === undefined || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    this.point(event.key === "Escape" ? -1 : Math.min(Math.max(to, 0), last));
    this.say(this.cursor < 0 ? "" : readingOf(this.run, this.cursor, panel.names, this.units));
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
    let copied = true;
    try {
      await navigator.clipboard.writeText(text);
    } catch { // a frame may have no clipboard: the text is shown, selected
      const field = element("textarea", { readOnly: true, value: text, rows: 3 });
      field.setAttribute("aria-label", "Text to copy");
      this.notice("Copy this text:", [field]);
      field.select();
      copied = document.execCommand("copy");
      if (copied) this.notice("");
      if (copied) button.focus();
    }
    if (!copied) return;
    button.textContent = "Copied";
    this.say("Copied.");
    setTimeout(() => { button.textContent = label; }, 1200);
  }

  // This page's address with the present settings.
  address() {
    return location.href.replace(/#.*$/, "") + toHash(this.data, this.settings);
  }

  changed() {
    this.notice("");
    this.schedule(true);
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
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.rest(), REST);
    this.stale = false;
    try {
      const run = this.simulate(this.settings);
      run.columns = { V: run.V };
      const { facts } = this.engine(this.settings);
      const { plane } = this.panels.at(-1);
      const estimates = facts.estimates.map((item) => item.name);
      const names = ["y", "y_r", "e", "v", "u", ...facts.compensator.slice(0, 2), ...estimates, ...(plane ?? [])];
      for (const name of names) run.columns[name] = run.column(name);
      run.truths = Object.fromEntries(facts.estimates.map((item) => [item.name, evaluate(item.truth, run.values)]));
      run.peakV = run.peak("v");
      run.peakE = run.peak("e");
      run.limits = limitsOf(facts, run.values);
      this.run = run;
      this.alert(run.status === 1 ? "" : `The run ${run.message}.`);
      document.body.classList.remove("lost");
    } catch (error) {
      this.alert(`${error.message}.`);
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
      const spec = { ...panel.build(this.run, this.kept, this.colors, panel), labels: panel.labels };
      const appears = panel.figure.hidden && !spec.absent;
      panel.figure.hidden = Boolean(spec.absent);
      if (spec.absent) continue;
      if (appears) panel.plot.resize();
      panel.plot.draw(spec, this.colors, this.cursor);
      const known = this.cursor >= 0 && this.cursor < this.run.rows;
      const text = known ? readingOf(this.run, this.cursor, panel.names, this.units) : "";
      if (panel.output.textContent !== text) panel.output.textContent = text;
    }
  }

  summary() {
    const entries = figuresOf(this.run, this.units);
    const place = document.getElementById("summary");
    if (!place.children.length) {
      place.append(...entries.map(([name]) => element("div", {}, element("dt", {}, name), element("dd", {}, element("span"), element("small")))));
    }
    entries.forEach(([, value, unit], i) => {
      const [text, small] = place.children[i].lastChild.children;
      text.textContent = value;
      small.textContent = unit && unit !== "1" ? ` ${powers(unit)}` : "";
    });
  }

  // What need not follow every frame: the link, the command, descriptions, the table.
  rest() {
    this.keepAddress();
    document.getElementById("command").textContent = commandLine(this.data, this.fitting(this.settings));
    if (!this.run) return;
    for (const panel of this.panels.filter(({ figure }) => !figure.hidden)) {
      panel.canvas.setAttribute("aria-label", descriptionOf(panel, this.run, this.units));
    }
    this.table();
    const [computed, whole] = [0, 1].map((i) => median(this.frames.map((frame) => frame[i])));
    document.getElementById("timing").textContent = `A run takes ${computed.toFixed(1)} ms, with its plots ${whole.toFixed(1)} ms.`;
    const lost = document.body.classList.contains("lost");
    if (!lost) this.say(announcement(this.run, this.units)); // an alert is read out by itself
  }

  keepAddress() {
    if (!document.getElementById("notice").hidden) return; // a link that was refused stays to be read
    try {
      history.replaceState(null, "", this.address());
    } catch { // a frame without an address of its own: the settings stay in the page
    }
  }

  say(text) {
    const place = document.getElementById("spoken");
    if (place.textContent !== text) place.textContent = text;
  }

  table() {
    if (!document.getElementById("table").open || !this.run) return;
    const columns = { ...this.run.columns, t: this.run.t };
    const names = ["t", ...Object.keys(this.run.columns)].filter((name) => columns[name].some(Number.isFinite));
    const unitOf = (name) => (name === "t" ? " s" : withUnit("", this.units.of(name)));
    const count = Math.min(TABLE_ROWS, this.run.rows);
    const rows = Array.from({ length: count }, (_, i) => Math.round((i * (this.run.rows - 1)) / Math.max(1, count - 1)));
    const head = element("tr", {}, ...names.map((name) => element("th", { scope: "col" }, ...pretty(name), element("small", {}, unitOf(name)))));
    const cell = (name, row) => (name === "t" ? element("th", { scope: "row" }, short(row, 6)) : element("td", {}, short(row, 6)));
    const body = rows.map((row) => element("tr", {}, ...names.map((name) => cell(name, columns[name][row]))));
    const caption = element("caption", { className: "hidden" }, "Signals of the run at equal intervals");
    document.getElementById("rows").replaceChildren(element("table", {}, caption, element("thead", {}, head), element("tbody", {}, ...body)));
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

function limitsOf(facts, values) {
  const [low, high] = facts.limits.length > 1 ? facts.limits.map((name) => values[name]) : [-values[facts.limit], values[facts.limit]];
  return [low, high];
}

main();
