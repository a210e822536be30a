"use strict";
// What tests ask of a page, in one place.
window.probe = {
  text: (id) => document.getElementById(id).textContent,

  hidden: (id) => document.getElementById(id).hidden,

  label: (id) => document.getElementById(id).getAttribute("aria-label"),

  unfold: () => document.querySelectorAll("details").forEach((node) => { node.open = true; }),

  // Left, top, width and height of an element in the window, px.
  box: (id) => {
    const { x, y, width, height } = document.getElementById(id).getBoundingClientRect();
    return [x, y, width, height];
  },

  // What has the focus: its id, or its words.
  focused: () => {
    const node = document.activeElement;
    return node === document.body ? "" : node.id || node.getAttribute("aria-label") || node.value || node.textContent;
  },

  // Whether it shows that it has the focus; a radio button shows it around its words.
  outlined: () => {
    const node = document.activeElement;
    const { outlineStyle, outlineWidth } = getComputedStyle(node.matches("[type=radio]") ? node.parentElement : node);
    return outlineStyle !== "none" && parseFloat(outlineWidth) >= 1;
  },

  rest: () => new Promise((done) => { setTimeout(done, REST + 50); }),

  // Width and height of all that a finger can hit, px.
  targets: () => {
    const nodes = document.querySelectorAll("button, .choices label, summary, #controls .row input");
    return Object.fromEntries([...nodes].map((node) => {
      const { width, height } = node.getBoundingClientRect();
      return [node.id || node.getAttribute("aria-label") || node.textContent, [width, height]];
    }));
  },

  // The contrast of every element with text of its own against what lies behind it, the least first.
  contrasts: () => {
    const canvas = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
    const painted = (...layers) => {
      canvas.clearRect(0, 0, 1, 1);
      for (const layer of layers) {
        canvas.fillStyle = layer;
        canvas.fillRect(0, 0, 1, 1);
      }
      return [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3);
    };
    const linear = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
    const light = (rgb) => rgb.reduce((sum, c, i) => sum + linear(c / 255) * [0.2126, 0.7152, 0.0722][i], 0);
    const found = [];
    const check = (what, ink, behind) => {
      const [a, b] = [light(painted(...behind, ink)), light(painted(...behind))];
      found.push([(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), what]);
    };
    for (const node of document.querySelectorAll("body *")) {
      const own = [...node.childNodes].some((child) => child.nodeType === Node.TEXT_NODE && child.data.trim());
      const written = own || node.matches("input[type=number]");
      if (!written || !node.checkVisibility() || node.matches("script, .hidden")) continue;
      const behind = [];
      for (let at = node; at; at = at.parentElement) behind.unshift(getComputedStyle(at).backgroundColor);
      check(`${node.tagName} ${node.textContent.trim().slice(0, 30)}`, getComputedStyle(node).color, behind);
    }
    const { colors } = explorer;
    for (const name of ["soft", "ink", "orange"]) check(`canvas ${name}`, colors[name], [colors.card]);
    return found.sort((a, b) => a[0] - b[0]);
  },

  // A run with settings that differ from the model's own, thinned; what its link gives back; its command.
  run: (change, every) => {
    const { data } = explorer;
    const settings = Object.assign(defaultSettings(data), change);
    const run = explorer.simulate(settings);
    const thin = (name) => [...run.column(name)].filter((_, i) => i % every === 0);
    const names = [...explorer.engine(settings).columns.keys()];
    const { status, ise, saturated, settling, values } = run;
    const found = { status, ise, saturated, settling, values, peak: run.peak("v"), V: run.V[0] };
    found.switches = run.switches.map(([t]) => t);
    found.columns = Object.fromEntries(names.map((name) => [name, thin(name)]));
    const back = fromHash(data, toHash(data, settings));
    found.notice = back.notice;
    found.same = toHash(data, back.settings) === toHash(data, settings) && explorer.simulate(back.settings).ise === ise;
    found.command = commandLine(data, explorer.fitting(settings));
    return found;
  },
};
