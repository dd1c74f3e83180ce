// The drawing of the network: nodes, copper, fibres; light and photons where they are.

import { end, rate } from "./state.js";

const SVG = "http://www.w3.org/2000/svg";
const NODE = { width: 92, height: 44 };
const BESIDE = 12; // between fibres of the same two nodes
const FLOWS_S = 0.5; // after photons were seen somewhere they are shown as moving
const DASHES = 16, SPEED = 64; // px between photons that are shown as moving, and px/s
const STILL = matchMedia("(prefers-reduced-motion: reduce)");
const COLOURS = ["--quantum", "--path-1", "--path-2", "--path-3"];

function make(kind, attributes = {}, ...inside) {
  const element = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...inside);
  return element;
}

export class Drawing {
  constructor(svg, network, choose) {
    this.svg = svg;
    this.network = network;
    this.fibers = new Map(); // "q1:2" or "alice-q0" -> {fiber, far}
    this.elements = new Map(); // name -> element
    this.places = new Map(network.nodes.map((node) => [node.name, node]));
    this.kinds = new Map(network.nodes.map((node) => [node.name, node.kind]));
    this.draw(choose);
    this.fit();
    this.move();
  }

  draw(choose) {
    const behind = make("g"), before = make("g");
    for (const [one, two] of this.network.copper) behind.append(line("copper", this.places.get(one), this.places.get(two)));
    const beside = new Map();
    for (const fiber of this.network.fibers) {
      const between = fiber.ends.map((end) => end[0]).sort().join(" ");
      beside.set(between, [...(beside.get(between) ?? []), fiber]);
    }
    for (const fibers of beside.values()) {
      fibers.forEach((fiber, number) => behind.append(this.fiber(fiber, (number - (fibers.length - 1) / 2) * BESIDE, choose)));
    }
    for (const node of this.network.nodes) before.append(this.node(node, choose));
    this.svg.replaceChildren(behind, before);
  }

  fiber(fiber, offset, choose) {
    const [a, b] = fiber.ends.map(([node]) => this.places.get(node));
    const ends = moved(a, b, fiber.ends[0][0] < fiber.ends[1][0] ? offset : -offset);
    const keys = fiber.ends.map((each) => end(...each));
    this.fibers.set(keys[0], { fiber, far: keys[1] });
    this.fibers.set(keys[1], { fiber, far: keys[0] });
    const text = `fibre ${fiber.name}, ${fiber.km} km, ${fiber.loss_db.toFixed(2)} dB`;
    const photons = line("photons", ...ends), y = (ends[0].y + ends[1].y) / 2;
    const beside = y > (a.y + b.y) / 2 ? 17 : -9; // of two fibres between the same nodes the lower one's is below
    const group = make("g", { class: "fiber", tabindex: 0, role: "button", "aria-label": text },
      make("title", {}, text), line("near", ...ends), line("seen", ...ends), photons,
      make("text", { class: "small flow", x: (ends[0].x + ends[1].x) / 2, y: y + beside }));
    chooses(group, () => choose({ kind: "fiber", name: fiber.name, fiber }));
    group.dataset.keys = keys.join(" ");
    group.photons = photons;
    this.elements.set(fiber.name, group);
    return group;
  }

  node(node, choose) {
    const group = make("g", {
      class: `node ${node.kind.split(" ")[0]}`, tabindex: 0, role: "button",
      "aria-label": `${node.kind} ${node.name}`, transform: `translate(${node.x} ${node.y})`,
    });
    const { width, height } = NODE;
    group.append(make("rect", { x: -width / 2, y: -height / 2, width, height, rx: node.kind === "host" ? 8 : 1 }));
    group.append(make("text", { y: node.ip ? -7 : 0 }, node.name));
    if (node.ip) group.append(make("text", { y: 11, class: "small" }, node.ip));
    chooses(group, () => choose({ kind: node.kind, name: node.name, node }));
    this.elements.set(node.name, group);
    return group;
  }

  // Show a state at a moment (ms): what is lit, where photons go, what is cut or faulty, and, if
  // `numbers`, how many photons come. Return whether photons move.
  show(state, chosen, now, numbers) {
    const lit = this.lit(state, numbers), shift = ((SPEED * now) / 1000) % DASHES;
    let moves = false;
    for (const fiber of this.network.fibers) {
      const element = this.elements.get(fiber.name), light = lit.get(fiber.name);
      const keys = element.dataset.keys.split(" ");
      const classes = ["fiber"];
      if (light) {
        classes.push("lit");
        element.style.setProperty("--light", `var(${COLOURS[light.number % COLOURS.length]})`);
        if (state.t - light.t < FLOWS_S) {
          classes.push("flowing");
          moves = !STILL.matches;
          if (moves) element.photons.style.strokeDashoffset = light.back ? shift : -shift;
        }
      }
      if (numbers || !light) write(element.lastChild, light?.label ?? "");
      if (keys.some((key) => state.cut.has(key))) classes.push("cut");
      if (keys.some((key) => state.tapped.get(key))) classes.push("tapped");
      if (chosen?.name === fiber.name) classes.push("chosen");
      const text = classes.join(" ");
      if (element.getAttribute("class") !== text) element.setAttribute("class", text);
    }
    for (const node of this.network.nodes) {
      const classes = ["node", node.kind.split(" ")[0]];
      if (state.faulty.has(node.name)) classes.push("faulty");
      if (state.devices[node.name]?.state === "silent") classes.push("silent");
      if (chosen?.name === node.name) classes.push("chosen");
      const element = this.elements.get(node.name), text = classes.join(" ");
      if (element.getAttribute("class") !== text) element.setAttribute("class", text);
    }
    return moves;
  }

  // Fibres of the light paths that stand: name -> number of the path, its direction, last photons.
  lit(state, numbers) {
    const found = new Map();
    let number = 0;
    for (const [begin] of this.fibers) {
      const host = begin.includes(":") ? null : begin;
      if (!host) continue;
      const hops = this.follow(begin, state.ways);
      if (!hops) continue;
      const last = hops.at(-1);
      const t = Math.max(state.flows.get(begin)?.t ?? -9, state.flows.get(last.to)?.t ?? -9);
      for (const { fiber, from } of hops) {
        const keys = this.elements.get(fiber.name).dataset.keys.split(" ");
        found.set(fiber.name, { number, t, back: from !== keys[0] });
      }
      if (numbers) found.get(last.fiber.name).label = told(rate(state, last.to));
      number += 1;
    }
    return found;
  }

  follow(begin, ways) {
    const hops = [], seen = new Set();
    for (let at = begin; this.fibers.has(at) && !seen.has(at);) {
      seen.add(at);
      const { fiber, far } = this.fibers.get(at);
      hops.push({ fiber, from: at, to: far });
      if (!far.includes(":")) return hops;
      if (!ways.has(far)) return null;
      at = `${far.split(":")[0]}:${ways.get(far)}`;
    }
    return null;
  }

  fit() {
    const xs = this.network.nodes.map((node) => node.x), ys = this.network.nodes.map((node) => node.y);
    const left = Math.min(...xs) - NODE.width, top = Math.min(...ys) - NODE.height;
    this.box = [left, top, Math.max(...xs) + NODE.width - left, Math.max(...ys) + NODE.height - top];
    this.apply();
  }

  zoom(factor, x = this.box[0] + this.box[2] / 2, y = this.box[1] + this.box[3] / 2) {
    const [left, top, width, height] = this.box;
    this.box = [x - (x - left) * factor, y - (y - top) * factor, width * factor, height * factor];
    this.apply();
  }

  apply() {
    this.svg.setAttribute("viewBox", this.box.join(" "));
    const { clientWidth, clientHeight } = this.svg;
    const scale = Math.min((clientWidth || 800) / this.box[2], (clientHeight || 400) / this.box[3]);
    this.scale = scale;
    this.svg.classList.toggle("far", scale < 0.6); // px of the screen for one of the drawing
    this.svg.classList.toggle("farthest", scale < 0.4);
  }

  move() {
    const pointers = new Map();
    this.svg.addEventListener("wheel", (event) => {
      event.preventDefault();
      const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.svg.getScreenCTM().inverse());
      this.zoom(event.deltaY > 0 ? 1.15 : 1 / 1.15, point.x, point.y);
    }, { passive: false });
    this.svg.addEventListener("pointerdown", (event) => pointers.set(event.pointerId, event));
    this.svg.addEventListener("pointermove", (event) => {
      const last = pointers.get(event.pointerId);
      if (!last) return;
      if (pointers.size === 1) {
        this.box[0] -= (event.clientX - last.clientX) / this.scale;
        this.box[1] -= (event.clientY - last.clientY) / this.scale;
        this.apply();
      } else {
        const other = [...pointers.values()].find((each) => each.pointerId !== event.pointerId);
        const apart = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
        this.zoom(apart(last) / Math.max(apart(event), 1));
      }
      pointers.set(event.pointerId, event);
    });
    for (const end of ["pointerup", "pointercancel", "pointerleave"]) {
      this.svg.addEventListener(end, (event) => pointers.delete(event.pointerId));
    }
    new ResizeObserver(() => this.apply()).observe(this.svg);
  }
}

// What comes to the end of a path, in photons a second, and what is lost on its way.
function told({ photons, lost }) {
  if (!photons) return "";
  return `${photons.toLocaleString("en", { notation: "compact" })} photons/s, ${(100 * lost).toFixed(1)} % lost`;
}

function line(kind, a, b) {
  return make("line", { class: kind, x1: a.x, y1: a.y, x2: b.x, y2: b.y });
}

function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function moved(a, b, offset) {
  const length = Math.hypot(b.x - a.x, b.y - a.y) || 1;
  const x = (-(b.y - a.y) / length) * offset, y = ((b.x - a.x) / length) * offset;
  return [{ x: a.x + x, y: a.y + y }, { x: b.x + x, y: b.y + y }];
}

function chooses(element, call) {
  element.addEventListener("click", call);
  element.addEventListener("keydown", (event) => {
    if (event.key === "Enter" || event.key === " ") event.preventDefault(), call();
  });
}
