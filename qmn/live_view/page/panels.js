// The tables beside the drawing. Each number says its unit in the head of its column.

const SHOWN_SESSIONS = 30, SHOWN_MEMORIES = 40, SHOWN_DECISIONS = 200;

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
    row.forEach((cell, place) => show(line.cells[place] ?? line.insertCell(), cell));
  });
}

function show(there, cell) {
  if (cell instanceof Node) {
    if (!there.isEqualNode(cell)) there.replaceWith(cell);
    return;
  }
  const text = String(cell), kinds = typeof cell === "number" ? "number" : "";
  if (there.textContent !== text) there.textContent = text;
  if (there.className !== kinds) there.className = kinds;
}

// An estimate with its 95 % interval, by so many digits.
function estimate({ value, low, high }, digits, factor = 1) {
  const text = (number) => (factor * number).toFixed(digits);
  return `${text(value)} (${text(low)} to ${text(high)})`;
}

const unknown = (each) => (each.over ? "not measured" : "not yet known");

// What is known of how good a session's pairs are; S tells that, too.
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
  const heads = ["session", "between", "state", "set-up (ms)", "pairs", "pairs/s", "photons arrived", "lost (%)", "measured",
    "fidelity, or S of CHSH (95 %)", "errors in % (95 %)"];
  table(at, heads,
    newest.map((each) => {
      const took = Math.max(each.last - each.since, 1e-3);
      const ends = each.told.from ? `${each.told.from} → ${each.told.to}` : [...each.nodes].join(", ");
      const arrived = each.arrived - each.lost;
      return [
        element("td", each.id.slice(-6)), ends, each.says || "-", each.setup_ms?.toFixed(1) ?? "-", count(each.pairs),
        each.pairs ? count(Math.round(each.pairs / took)) : "-", count(arrived),
        each.arrived ? ((100 * each.lost) / each.arrived).toFixed(1) : "-", count(each.measured),
        fidelity(each), errors(each),
      ];
    }), "No session yet.");
}

export function outcomes(at, state) {
  const names = Object.keys(state.outcomes).sort();
  const total = names.reduce((sum, name) => sum + state.outcomes[name], 0);
  table(at, ["state", "pairs", "share (%)"], names.map((name) => {
    const share = (100 * state.outcomes[name]) / total, cell = element("td", ` ${share.toFixed(1)}`);
    const bar = element("span", "", "bar");
    bar.style.width = `${share}px`;
    cell.prepend(bar);
    return [name, count(state.outcomes[name]), cell];
  }), "No Bell measurement yet.");
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
  table(at, ["key link", "keys ready", "at the other end", "key (bit/s)", "QBER (%)", "state"], state.keyLinks.map((link) => [
    `${link.from_} → ${link.to}`, count(link.keys_ready), count(link.keys_ready_there), count(link.key_bits_per_s),
    link.qber === null ? "-" : (100 * link.qber).toFixed(2), link.state,
  ]), "No host has told of keys.");
}

export function job(at, state) {
  const rows = Object.entries(state.job).filter(([, value]) => value !== null && typeof value !== "object");
  table(at, ["what the program says", ""], rows.map(([name, value]) => [
    name.replaceAll("_", " "), typeof value === "number" ? value.toLocaleString("en", { maximumSignificantDigits: 6 }) : String(value),
  ]), "No program has said anything.");
}

export function decisions(at, state) {
  const newest = state.decisions.slice(-SHOWN_DECISIONS).reverse();
  at.replaceChildren(...newest.map(({ t, who, text }) => {
    const item = document.createElement("li");
    item.append(element("time", `${t.toFixed(3)} s `), element("b", `${who} `), text);
    return item;
  }));
}

const NOT_SHOWN = new Set(["heard_s_ago", "paths", "tuning"]);
const words = (text) => text.replaceAll("_", " ");

// Devices as the controller knows them: counts and settings of a host, faults and ports of a switch.
export function device(state, name) {
  const rows = [];
  if (state.faulty.has(name)) rows.push(["fault", state.faulty.get(name)]);
  for (const [field, value] of Object.entries(state.devices[name] ?? {})) {
    if (NOT_SHOWN.has(field)) continue;
    if (Array.isArray(value)) rows.push(...value.map((each) => [words(field).replace(/s$/, ""), list(each)]));
    else rows.push([words(field), list(value)]);
  }
  for (const { in_port, out_port } of state.devices[name]?.paths ?? []) rows.push(["light path", `${in_port} → ${out_port}`]);
  return rows;
}

// Values one behind the other, those of objects with their names, which say the unit.
function list(value) {
  if (value === null || typeof value !== "object") return typeof value === "number" ? count(value) : String(value);
  return Object.entries(value).filter(([name, each]) => each !== null && !NOT_SHOWN.has(name))
    .map(([name, each]) => (name === "up" ? (each ? "up" : "cut") : `${words(name)} ${list(each)}`)).join(", ") || "-";
}

export { element, table };
