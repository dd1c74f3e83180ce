// The acts on a chosen part: each a form, which becomes a command of qmn.

import { rate } from "./light.js";
import { count, device, element, ports, table } from "./panels.js";
import { end } from "./state.js";

const field = (name, words, value = "", kind = "") => ({ name, words, value, kind });

function formsOf(chosen, network) {
  const hosts = network.nodes.filter((node) => node.kind === "host").map((node) => node.name);
  if (chosen.kind === "fiber") {
    const [a, b] = chosen.fiber.ends.map((end) => end[0]), ends = { a, b };
    return [
      { act: "link", label: "cut", given: { ...ends, state: "down" } },
      { act: "link", label: "mend", given: { ...ends, state: "up" } },
      { act: "tap", label: "put eve on it", given: ends, fields: [field("fraction", "fraction measured", "1")] },
      { act: "tap", label: "take eve off", given: { ...ends, fraction: "0" } },
      { act: "classical", label: "classical light", given: ends, fields: [field("mw", "mW", "1")] },
      { act: "calibrate", label: "calibrate", given: ends },
    ];
  }
  if (chosen.kind === "quantum switch") {
    const given = { switch: chosen.name };
    return [
      { act: "stuck", label: "stuck", given, fields: [field("in_port", "in port"), field("out_port", "out port")] },
      { act: "temperature", label: "temperature", given, fields: [field("celsius", "°C", "60")] },
      { act: "repair", label: "repair", given },
    ];
  }
  if (chosen.kind === "host") {
    const others = hosts.filter((name) => name !== chosen.name);
    return [
      { act: "send", label: "send", given: { from: chosen.name },
        fields: [field("to", "to", others[0] ?? ""), field("text", "text", "hello", "text")] },
      { act: "set", label: "set", given: { host: chosen.name },
        fields: [field("setting", "setting", "rate-hz"), field("value", "value (or default)", "1000000")] },
    ];
  }
  return [];
}

export function show(at, chosen, network, state, perform, leave) {
  at.replaceChildren();
  if (!chosen) {
    at.append(element("h2", "Light paths"), scrolled("paths"), element("p", "Choose a node or a fibre to see more of it."));
    return;
  }
  const head = element("h2", `${chosen.kind === "fiber" ? "fibre" : chosen.kind} ${chosen.name}`), back = element("button", "×", "back");
  back.ariaLabel = "back to light paths";
  back.addEventListener("click", leave);
  head.append(back);
  at.append(head, scrolled("facts"), scrolled("ports"));
  refresh(at, chosen, state);
  if (!network.acts) {
    at.append(element("p", network.live ? "This page is read-only." : "This run is over: nothing can be done to it."));
    return;
  }
  const forms = document.createElement("div");
  forms.className = "acts";
  const result = element("p", "");
  result.setAttribute("role", "status");
  for (const form of formsOf(chosen, network)) forms.append(made(form, perform, result));
  forms.append(made({ act: "policy", label: "reload the policy", given: {} }, perform, result));
  at.append(forms, result);
}

function scrolled(id) {
  const box = element("div", "", "scroll"), made = document.createElement("table");
  made.id = id;
  box.append(made);
  return box;
}

export function refresh(at, chosen, state) {
  const rows = chosen.kind === "fiber" ? fiber(state, chosen.fiber) : device(state, chosen.name);
  table(at.querySelector("#facts"), ["what", "value"], rows, "Nothing is known of it yet.");
  ports(at.querySelector("#ports"), state, chosen.name);
}

function fiber(state, { ends, km, loss_db }) {
  const keys = ends.map((each) => end(...each));
  const known = (map) => keys.map((key) => map.get(key)).find((each) => each !== undefined) ?? 0;
  const rows = [["length", `${km} km`], ["loss", `${loss_db.toFixed(2)} dB`]];
  rows.push(["state", keys.some((key) => state.cut.has(key)) ? "cut" : "whole"]);
  rows.push(["measured by somebody", `${100 * known(state.tapped)} % of the photons`]);
  rows.push(["classical light", `${known(state.classical)} mW`]);
  for (const key of keys) {
    const { photons, lost } = rate(state, key);
    if (photons) rows.push([`photons to ${key}`, `${count(Math.round(photons))} /s, ${(100 * lost).toFixed(1)} % lost on their way`]);
  }
  return rows;
}

function made({ act, label, given, fields = [] }, perform, result) {
  const form = document.createElement("form");
  const inputs = fields.map(({ name, words, value, kind }) => {
    const box = document.createElement("label"), input = document.createElement("input");
    input.name = name;
    input.value = value;
    input.required = true;
    input.className = kind;
    box.append(`${words} `, input);
    return box;
  });
  const button = element("button", label);
  form.append(...inputs, button);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    button.disabled = true;
    result.textContent = "…";
    const done = await perform({ act, ...given, ...Object.fromEntries(new FormData(form)) });
    result.replaceChildren(element("code", done.command ? ["qmn", ...done.command].join(" ") : ""), ` ${done.output}`);
    result.className = done.status ? "failed" : "good";
    result.scrollIntoView({ block: "nearest" });
    button.disabled = false;
  });
  return form;
}
