// Feeds recorded samples to an exported controller.
// node replay.mjs WRAPPER COLUMNS INPUT OUTPUT, with COLUMNS {inputs, outputs, states} in JSON; INPUT and OUTPUT are
// rows of doubles. Prints {self_test, init, flags, imports, step_ns} in JSON.
import { readFileSync, writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [wrapper, columns, input, output] = process.argv.slice(2);
const { Controller, load } = await import(pathToFileURL(wrapper));
const { inputs, outputs, states } = JSON.parse(columns);
const bytes = readFileSync(input);
const given = new Float64Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength));
const rows = given.length / inputs.length;
const found = new Float64Array(rows * (outputs.length + states.length));
const module = await load();
const samples = Array.from({ length: rows }, (_, k) =>
  Object.fromEntries(inputs.map((name, i) => [name, given[k * inputs.length + i]])),
);
const controller = new Controller(module);
const told = {
  self_test: controller.selfTest(),
  imports: WebAssembly.Module.imports(module).length,
  init: controller.init(samples[0]),
  flags: 0,
};
let place = 0;
for (const sample of samples) {
  const out = controller.step(sample);
  told.flags |= out.flags;
  for (const name of outputs) {
    found[place++] = out[name];
  }
  for (const name of states) {
    found[place++] = controller.state[name];
  }
}
let best = Infinity; // of five passes, the first of which also compile
for (let pass = 0; pass < 5; ++pass) {
  const before = process.hrtime.bigint();
  for (const sample of samples) {
    controller.step(sample);
  }
  best = Math.min(best, Number(process.hrtime.bigint() - before) / rows);
}
told.step_ns = best;
writeFileSync(output, new Uint8Array(found.buffer));
console.log(JSON.stringify(told));
