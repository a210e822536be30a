"use strict";
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
