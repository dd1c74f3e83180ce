// The drawing of the network: nodes, copper, fibres; light and photons where they are.

import { rate, sending, wayFrom } from "./light.js";
import { around, Taken } from "./layout.js";
import { end } from "./state.js";

const SVG = "http://www.w3.org/2000/svg";
const NODE = { width: 92, height: 44 };
const TURNED = { x: 116 / 90, y: 0.36 }; // columns as rows: of what was between nodes of one, and between them
const LEAST_PX = 224, MOST_PX = 576, MOST_SHARE = 0.6; // height of the drawing, and of the window
const READABLE = 0.6; // px of the screen for one of the drawing: names in boxes are still read
const SMALL_LETTER_PX = 5.4; // of what a fibre's label says
const DOT_PX = 7, LETTER_PX = 7.2, LINE_PX = 15; // of a map: dots, and names of them
const BESIDE = 12; // between fibres of the same two nodes
const FLOWS_S = 0.5; // after photons were seen somewhere they are shown as moving
const DASHES = 16, SPEED = 64; // px between photons that are shown as moving, and px/s
const STILL = matchMedia("(prefers-reduced-motion: reduce)");
const SPOKEN = [["lit", "has light"], ["cut", "cut"], ["tapped", "somebody measures"], ["faulty", "faulty"], ["silent", "silent"], ["eve", "eavesdrops"]];
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
    this.choose = choose;
    this.map = !network.columns; // nodes are as large from near and far, to tell them apart
    svg.classList.toggle("map", this.map);
    this.draw(false);
    this.fit();
    this.move();
  }

  // Where nodes are; `turned`: columns lie, as a phone is narrow and high.
  placed(turned) {
    const of = ({ x, y }) => (turned ? { x: y * TURNED.x, y: x * TURNED.y } : { x, y });
    return new Map(this.network.nodes.map((node) => [node.name, of(node)]));
  }

  // The first view: the whole drawing, with room for boxes.
  extent(places) {
    const xs = [...places.values()].map(({ x }) => x), ys = [...places.values()].map(({ y }) => y);
    const left = Math.min(...xs) - 0.6 * NODE.width, top = Math.min(...ys) - NODE.height;
    return [left, top, Math.max(...xs) + 0.6 * NODE.width - left, Math.max(...ys) + NODE.height - top];
  }

  draw(turned) {
    const choose = this.choose;
    this.turned = turned;
    this.places = this.placed(turned);
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
    fiber.ends.forEach(([node], number) => this.fibers.set(keys[number], { fiber, far: keys[1 - number], node }));
    const text = `fibre ${fiber.name}, ${fiber.km} km, ${fiber.loss_db.toFixed(2)} dB`;
    const photons = line("photons", ...ends), middle = (ends[0].y + ends[1].y) / 2;
    const beside = middle > (a.y + b.y) / 2 ? 17 : -9; // of two fibres between the same nodes the lower one's is below
    // Fibres of horizontal columns meet at a switch: their labels are not side by side.
    const along = this.turned ? [0.35, 0.65][this.elements.size % 2] : 0.5;
    const [x, y] = ["x", "y"].map((name) => ends[0][name] + along * (ends[1][name] - ends[0][name]));
    // A label lies along its fibre, so that no line crosses it.
    const slope = (Math.atan2(ends[1].y - ends[0].y, ends[1].x - ends[0].x) * 180) / Math.PI;
    const turn = slope > 90 ? slope - 180 : slope <= -90 ? slope + 180 : slope;
    const group = make("g", { class: "fiber", tabindex: 0, role: "button", "aria-label": text },
      make("title", {}, text), line("near", ...ends), line("seen", ...ends), photons,
      make("text", { class: "small flow", y: beside, transform: `translate(${x} ${y}) rotate(${turn})` }));
    const room = Math.hypot(ends[1].x - ends[0].x, ends[1].y - ends[0].y) - NODE.height;
    group.label = { x, y, turn, room };
    chooses(group, () => choose({ kind: "fiber", name: fiber.name, fiber }));
    group.dataset.keys = keys.join(" ");
    group.photons = photons;
    this.elements.set(fiber.name, group);
    return group;
  }

  node(node, choose) {
    const group = make("g", {
      class: `node ${node.kind.split(" ")[0]}`, tabindex: 0, role: "button",
      "aria-label": `${node.kind} ${node.name}`,
    });
    const { width, height } = NODE, { x, y } = this.places.get(node.name);
    group.setAttribute("transform", `translate(${x} ${y})`);
    group.append(make("title", {}, [node.kind, node.name, node.ip].filter(Boolean).join(" ")));
    group.append(make("rect", { class: "box", x: -width / 2, y: -height / 2, width, height, rx: node.kind === "host" ? 8 : 1 }));
    const half = DOT_PX / 2;
    group.append(make("rect", { class: "dot", x: -half, y: -half, width: DOT_PX, height: DOT_PX, rx: node.kind === "host" ? half : 0 }));
    group.append(make("text", { class: "name", y: node.ip ? -7 : 0 }, node.name));
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
        classes.push(light.stands ? "lit" : "glow");
        element.style.setProperty("--light", `var(${COLOURS[light.number % COLOURS.length]})`);
        if (light.flows) {
          classes.push("flowing");
          moves ||= !STILL.matches;
          if (!STILL.matches) element.photons.style.strokeDashoffset = light.back ? shift : -shift;
        }
      }
      const text = light?.label ?? "", fits = this.map || SMALL_LETTER_PX * text.length < element.label.room;
      if (numbers || !light) write(element.lastChild, fits ? text : "");
      if (keys.some((key) => state.cut.has(key))) classes.push("cut");
      if (keys.some((key) => state.tapped.get(key)) || fiber.ends.some(([node]) => state.eve[node])) classes.push("tapped");
      if (numbers) speak(element, SPOKEN.filter(([kind]) => classes.includes(kind)));
      if (chosen?.name === fiber.name) classes.push("chosen");
      dress(element, classes);
    }
    for (const node of this.network.nodes) {
      const classes = ["node", node.kind.split(" ")[0]], element = this.elements.get(node.name);
      if (state.faulty.has(node.name)) classes.push("faulty");
      if (state.devices[node.name]?.state === "silent") classes.push("silent");
      if (state.eve[node.name]) classes.push("eve");
      if (numbers) speak(element, SPOKEN.filter(([kind]) => classes.includes(kind)));
      if (chosen?.name === node.name) classes.push("chosen");
      if (element.named) classes.push("named");
      dress(element, classes);
    }
    return moves;
  }

  // Light paths that stand, or did until just now: from where to where, by which fibres and switches.
  paths(state) {
    const found = [], part = (port) => this.network.parts[port];
    const inside = new Set([...state.ways.keys(), ...state.closed.keys()].filter(part));
    for (const port of [...this.fibers.keys()].filter((each) => !each.includes(":")).concat(...inside)) {
      const hops = this.follow(inside.has(port) ? `${port.split(":")[0]}:${wayFrom(state, port)}` : port, state);
      if (!hops.length) continue;
      const stands = [port, ...hops.map(({ to }) => to)].every((each) => !each.includes(":") || state.ways.has(each));
      const last = hops.at(-1).to, ended = last.includes(":");
      const begin = part(port) || port, finish = ended ? part(`${last.split(":")[0]}:${wayFrom(state, last)}`) : last;
      const by = hops.slice(0, ended ? hops.length : -1).map(({ to }) => to.split(":")[0]);
      const [from, to] = [begin, finish].map((name) => this.fibers.get(name)?.node ?? name);
      found.push({ begin, end: finish, from, to, by, hops, stands, ...rate(state, finish) });
    }
    return found;
  }

  // Fibres of light paths: name -> number of the path, its direction, whether it stands, whether photons fly.
  lit(state, numbers) {
    const found = new Map(), ports = sending(state);
    this.paths(state).forEach(({ begin, end: last, hops, stands, photons, lost }, number) => {
      const t = Math.max(state.flows.get(begin)?.t ?? -9, state.flows.get(last)?.t ?? -9);
      const flows = state.t - t < FLOWS_S || (stands && ports.has(begin));
      for (const { fiber, from } of hops) {
        const keys = this.elements.get(fiber.name).dataset.keys.split(" ");
        found.set(fiber.name, { number, stands, flows, back: from !== keys[0] });
      }
      if (numbers) found.get(hops.at(-1).fiber.name).label = rateText({ photons, lost });
    });
    return found;
  }

  // Fibres in which somebody measures a fraction of the photons.
  tapped(state) {
    const fractionOf = (fiber) => Math.max(0, ...fiber.ends.map((each) => state.tapped.get(end(...each)) ?? 0));
    return this.network.fibers.map((fiber) => ({ name: fiber.name, fraction: fractionOf(fiber) })).filter(({ fraction }) => fraction);
  }

  // The fibres from a port to a host or into a part of a switch; none where light ends elsewhere.
  follow(begin, state) {
    const hops = [], seen = new Set();
    for (let at = begin; this.fibers.has(at) && !seen.has(at);) {
      seen.add(at);
      const { fiber, far } = this.fibers.get(at);
      hops.push({ fiber, from: at, to: far });
      if (!far.includes(":")) return hops;
      const way = wayFrom(state, far);
      if (way === undefined) return [];
      at = `${far.split(":")[0]}:${way}`;
      if (this.network.parts[at]) return hops;
    }
    return [];
  }

  // Show all of it, in the direction in which it is larger; the drawing is as high as it needs.
  fit() {
    const room = { width: this.svg.clientWidth || 800, height: Math.min(MOST_PX, MOST_SHARE * innerHeight) };
    const scale = ([, , width, height]) => Math.min(room.width / width, room.height / height);
    const lying = this.extent(this.placed(true)), standing = this.extent(this.placed(false));
    const turned = !this.map && scale(standing) < READABLE && scale(lying) > scale(standing);
    if (turned !== this.turned) this.draw(turned);
    this.svg.classList.toggle("turned", turned);
    this.box = turned ? lying : standing;
    this.room = room.width;
    const height = this.map ? room.height : Math.max(LEAST_PX, Math.min(room.height, room.width * (this.box[3] / this.box[2])));
    this.svg.style.height = `${Math.round(height)}px`;
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
    this.scale = scale; // px of the screen for one of the drawing
    this.svg.classList.toggle("far", !this.map && scale < READABLE);
    this.svg.classList.toggle("farthest", !this.map && scale < 0.4);
    if (this.map && scale !== this.arranged) this.arrange(scale);
  }

  // On a map nodes are boxes where there is room for all of them, else dots; of dots those have their
  // names beside them for which there is room, hosts first.
  arrange(scale) {
    this.arranged = scale;
    const nodes = [...this.network.nodes].sort((one, two) => (two.kind === "host") - (one.kind === "host"));
    const at = (node) => ({ x: node.x * scale, y: node.y * scale });
    const taken = new Taken(NODE.width);
    const boxes = nodes.every((node) => taken.take(around(at(node), NODE.width, NODE.height)));
    this.svg.classList.toggle("dots", !boxes);
    const dots = new Taken(NODE.width);
    if (!boxes) for (const node of nodes) dots.take(around(at(node), DOT_PX, DOT_PX), true);
    for (const node of nodes) {
      const element = this.elements.get(node.name), { x, y } = at(node);
      element.setAttribute("transform", `translate(${node.x} ${node.y}) scale(${1 / scale})`);
      const name = { left: x + DOT_PX, right: x + DOT_PX + LETTER_PX * node.name.length, top: y - LINE_PX / 2, bottom: y + LINE_PX / 2 };
      element.named = boxes || dots.take(name);
      element.classList.toggle("named", element.named);
    }
    for (const fiber of this.network.fibers) {
      const { label, lastChild } = this.elements.get(fiber.name);
      lastChild.setAttribute("transform", `translate(${label.x} ${label.y}) rotate(${label.turn}) scale(${1 / scale})`);
    }
  }

  move() {
    this.svg.addEventListener("click", (event) => event.target === this.svg && this.choose(null));
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
    // A window that is turned shows the whole network again; otherwise the view stays.
    new ResizeObserver(() => (this.svg.clientWidth === this.room ? this.apply() : this.fit())).observe(this.svg);
  }
}

// A screen reader hears of anything unusual, behind the name.
function speak(element, kinds) {
  element.spoken ??= element.getAttribute("aria-label");
  const text = [element.spoken, ...kinds.map(([, words]) => words)].join(", ");
  if (element.getAttribute("aria-label") !== text) element.setAttribute("aria-label", text);
}

function dress(element, classes) {
  const text = classes.join(" ");
  if (element.getAttribute("class") !== text) element.setAttribute("class", text);
}

// Photons a second at the end of a path, and the lost share.
function rateText({ photons, lost }) {
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
