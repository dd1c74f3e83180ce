// The tables beside the drawing. Each number says its unit in the head of its column.

const SHOWN_SESSIONS = 30, SHOWN_MEMORIES = 40, SHOWN_DECISIONS = 200, SHOWN_PATHS = 40;

import { digits, moment, plain, quantity } from "./words.js";

export const count = (number) => (number ?? 0).toLocaleString("en");

function element(kind, text, kinds = "") {
  const made = document.createElement(kind);
  made.textContent = text;
  if (kinds) made.className = kinds;
  return made;
}

// Four times a second: cells stay, and only what they say changes.
function table(at, heads, rows, empty) {
  if (!rows.length) {
    at.replaceChildren(element("caption", empty));
    return;
  }
  if (!at.tHead) {
    const head = document.createElement("thead"), line = document.createElement("tr");
    line.append(...heads.map((text) => { const th = element("th", text); th.scope = "col"; return th; }));
    head.append(line);
    at.replaceChildren(head, document.createElement("tbody"));
  }
  const body = at.tBodies[0];
  while (body.rows.length > rows.length) body.deleteRow(-1);
  rows.forEach((row, number) => {
    const line = body.rows[number] ?? body.insertRow();
    row.forEach((cell, place) => {
      show(line.cells[place] ?? line.insertCell(), cell);
      if (line.cells[place].dataset.head !== heads[place]) line.cells[place].dataset.head = heads[place]; // on a phone
    });
  });
}

function show(there, cell) {
  if (cell instanceof Node) {
    if (there.dataset.head) cell.dataset.head = there.dataset.head;
    if (!there.isEqualNode(cell)) there.replaceWith(cell);
    return;
  }
  const text = String(cell), kinds = typeof cell === "number" ? "number" : "";
  if (there.textContent !== text) there.textContent = text;
  if (there.className !== kinds) there.className = kinds;
}

// An estimate with its 95 % interval, to a number of digits.
function estimate({ value, low, high }, digits, factor = 1) {
  const text = (number) => (factor * number).toFixed(digits);
  return `${text(value)} (${text(low)} to ${text(high)})`;
}

const OF_SWITCH = /-(memory|source|analyser)\d+$/; // a part: its switch is enough
const unknown = (each) => (each.over ? "not measured" : "not yet known");

// The fidelity of a session's pairs, or S.
function fidelity(each) {
  const { fidelity, chsh } = each.estimates, texts = [];
  if (fidelity) texts.push(estimate(fidelity, 4));
  if (chsh) texts.push(`S ${estimate(chsh, 3)}`);
  return texts.join("; ") || unknown(each);
}

function errors(each) {
  const { qber, error_rate } = each.estimates, texts = [];
  if (qber) texts.push(`QBER ${estimate(qber, 2, 100)}`);
  if (error_rate) texts.push(estimate(error_rate, 2, 100));
  return texts.join("; ") || unknown(each);
}

export function sessions(at, state) {
  const newest = [...state.sessions.values()].sort((one, two) => two.last - one.last).slice(0, SHOWN_SESSIONS);
  const heads = ["session", "service", "between", "state", "set-up (ms)", "pairs or photons", "per s", "photons arrived", "lost (%)", "measured",
    "fidelity, or S of CHSH (95 %)", "errors in % (95 %)"];
  table(at, heads,
    newest.map((each) => {
      // Of blocks that have come: a block that is on its way is counted when it was made.
      const [made, began] = each.came ? [each.came, each.began] : [each.pairs, each.since];
      const known = each.report.from ? each.report : each.asked;
      const ends = known.from ? `${known.from} → ${known.to}` : [...new Set([...each.nodes].map((name) => name.replace(OF_SWITCH, "")))].join(", ");
      const arrived = each.arrived - each.lost;
      return [
        element("td", each.id.slice(-6)), plain(known.service ?? "-"), ends, each.says || "-", each.setup_ms?.toFixed(1) ?? "-", count(each.pairs),
        made ? count(Math.round(made / Math.max(each.last - began, 1e-3))) : "-", count(arrived),
        each.arrived ? ((100 * each.lost) / each.arrived).toFixed(1) : "-", count(each.measured),
        fidelity(each), errors(each),
      ];
    }), "No session yet.");
}

export function outcomes(at, state) {
  const names = Object.keys(state.outcomes).sort();
  const total = names.reduce((sum, name) => sum + state.outcomes[name], 0);
  table(at, ["state", "pairs", "share (%)"], names.map((name) => {
    const share = (100 * state.outcomes[name]) / total;
    return [SHOWN_AS[name] ?? name, count(state.outcomes[name]), withBar(share.toFixed(1), share)];
  }), "No Bell measurement yet.");
}

const SHOWN_AS = { "Phi+": "Φ+", "Phi-": "Φ−", "Psi+": "Ψ+", "Psi-": "Ψ−" };

function withBar(text, px) {
  const cell = element("td", ` ${text}`), bar = element("span", "", "bar");
  bar.style.width = `${px}px`;
  cell.prepend(bar);
  return cell;
}

// Light paths that stand, and those that have closed just now.
export function paths(at, found) {
  table(at, ["light path", "by", "photons/s", "lost (%)", "state"], found.slice(0, SHOWN_PATHS).map((each) => [
    `${each.from} → ${each.to}`, each.by.join(", ") || "-", each.photons ? count(Math.round(each.photons)) : "-",
    each.photons ? (100 * each.lost).toFixed(1) : "-", each.stands ? "stands" : "closed",
  ]), "No light path stands.");
}

export function memories(at, state) {
  const rows = [];
  for (const [node, blocks] of state.memories) {
    const held = [...blocks.values()];
    if (!held.length) continue;
    const qubits = held.reduce((sum, each) => sum + each.photons, 0);
    rows.push([node, count(qubits), (state.t - Math.min(...held.map((each) => each.t))).toFixed(3)]);
  }
  table(at, ["node", "qubits stored", "oldest (s)"], rows.slice(0, SHOWN_MEMORIES), "No qubit is in a memory.");
}

export function keys(at, state) {
  table(at, ["key link", "keys ready", "at the other end", "store full (%)", "key (bit/s)", "QBER (%)", "state", "store has room for (keys)"], state.keyLinks.map((link) => [
    `${link.from_} → ${link.to}`, count(link.keys_ready), count(link.keys_ready_there), full(link), count(link.key_bits_per_s),
    link.qber === null ? "-" : (100 * link.qber).toFixed(2), link.state, link.max_key_count ? count(link.max_key_count) : "-",
  ]), "No key links.");
}

// A store holds the keys of either end; records of earlier versions do not tell of how many it has room for.
function full({ keys_ready, keys_ready_there, max_key_count }) {
  return max_key_count ? digits((100 * (keys_ready + keys_ready_there)) / max_key_count, 2) : "-";
}

const OF_NO_USE = new Set(["event", "session"]);

export function job(at, state) {
  const rows = Object.entries(state.job).filter(([name, value]) => !OF_NO_USE.has(name) && value !== null && typeof value !== "object");
  table(at, ["output of the program", ""], rows.map(([name, value]) => quantity(name, value)), "No output yet.");
}

export function decisions(at, state) {
  const newest = state.decisions.slice(-SHOWN_DECISIONS).reverse();
  at.replaceChildren(...newest.map(({ t, who, text }) => {
    const item = document.createElement("li");
    item.append(element("time", `${moment(t)} `), element("b", `${who} `), text);
    return item;
  }));
}

const APART = new Set(["heard_s_ago", "paths", "tuning", "ports", "name", "kind", "dpid"]);

// Devices as the controller knows them: counts and settings of a host, faults of a switch.
export function device(state, name) {
  const rows = [], device = state.devices[name] ?? {};
  if (state.faulty.has(name)) rows.push(["fault", state.faulty.get(name)]);
  for (const [field, value] of Object.entries(device)) if (!APART.has(field)) rows.push([plain(field), list(field, value)]);
  if (!device.dpid) for (const port of device.ports ?? []) rows.push([`port ${port.name}`, port.up ? "up" : "cut"]);
  return rows;
}

// Values one behind the other, those of objects with their names.
function list(field, value) {
  if (Array.isArray(value)) return value.map((each) => list(field, each)).join(", ") || "-";
  if (value === null || typeof value !== "object") return quantity(field, value ?? "-")[1];
  const known = Object.entries(value).filter(([, each]) => each !== null);
  return known.map(([name, each]) => quantity(name, each).join(" ")).join(", ") || "-";
}

// Ports of a switch: where light that comes in leaves, photons, and what optics tell.
export function ports(at, state, name) {
  const { ports = [], paths = [], dpid } = state.devices[name] ?? {};
  if (!dpid) return at.replaceChildren();
  const ways = new Map(paths.map(({ in_port, out_port }) => [in_port, out_port]));
  const optics = (light, field) => (light?.[field] == null ? "-" : quantity(field, light[field])[1]);
  table(at, ["port", "state", "light to port", "photons in", "out", "lost", "frequency", "sent", "received", "temperature"], ports.map((each) => [
    each.port, each.up ? "up" : "cut", ways.get(each.port) ?? "-", count(each.photons_in), count(each.photons_out), count(each.photons_lost),
    optics(each.light, "frequency_mhz"), optics(each.light, "tx_power_dbm"), optics(each.light, "rx_power_dbm"), optics(each.light, "temperature_c"),
  ]), "No ports yet.");
}

export { element, table };
