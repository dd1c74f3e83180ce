// The state of a network as messages tell it, one after the other. `apply` is all that changes it.

const GATHERED = /^(\d+) of \d+ of (\d+\/\d+)(, still stored)?/;
const OUTCOME = /(?:Phi|Psi)[+-]=(\d+)/g;
const TAPPED = /^tapped (\S+)/, LIT = /^classical light (\S+)/;
export const BUCKET_S = 0.1;
const RATE_BUCKETS = 10; // of a port, over which its rate is told
const MOST_DECISIONS = 300, MOST_SESSIONS = 300;
export const WINDOW_S = 60; // of which buckets are kept
const ENDED = new Set(["torn_down", "refused", "forbidden"]);

export function blank() {
  return {
    t: 0,
    ways: new Map(), // "q1:2" -> "4": cross-connects that stand
    sessions: new Map(),
    memories: new Map(), // node -> Map of block -> {photons, t}
    flows: new Map(), // "alice-q0" -> {photons, lost, t, session} of the last light there, and its buckets
    outcomes: {},
    buckets: new Map(), // number of a BUCKET_S -> {pairs, arrived, lost}
    decisions: [],
    cut: new Set(), // "q1:2"
    tapped: new Map(), // "q1:2" or "alice-q0" -> fraction that somebody measures
    classical: new Map(), // the same -> mW
    faulty: new Map(), // switch -> what is wrong with it
    devices: {}, // of hosts and switches, as the controller knows them
    keyLinks: [], // with the keys that are ready at either end
    job: {},
    missed: 0,
  };
}

export function apply(state, message, names) {
  state.t = Math.max(state.t, message.t);
  handlers[message.what]?.(state, message, names);
}

const handlers = { event, controller, act, devices, job, fault };

function event(state, m) {
  const here = m.session && session(state, m.session, m.t);
  const count = m.photons ?? 0;
  if (here) here.nodes.add(m.node);
  switch (m.kind) {
    case "open": {
      const [from, , to] = m.detail.split(" ");
      state.ways.set(`${m.node}:${from}`, to);
      break;
    }
    case "close":
      state.ways.delete(`${m.node}:${m.port}`);
      break;
    case "create":
      if (here) here.pairs += count;
      bucket(state, m.t).pairs += count;
      break;
    case "send":
      flow(state, m);
      break;
    case "arrive":
      flow(state, m);
      if (here) here.arrived += count, here.lost += m.lost ?? 0;
      bucket(state, m.t).arrived += count - (m.lost ?? 0);
      bucket(state, m.t).lost += m.lost ?? 0;
      break;
    case "bell-measure":
      for (const [text, number] of m.detail.matchAll(OUTCOME)) {
        const name = text.split("=")[0];
        state.outcomes[name] = (state.outcomes[name] ?? 0) + Number(number);
      }
      if (here) here.measured += count;
      break;
    case "measure":
      if (here) here.measured += count;
      break;
    case "store":
      memory(state, m.node).set(block(m), { photons: count, t: m.t });
      break;
    case "gather": {
      const [, moved, from, stored] = m.detail.match(GATHERED) ?? [];
      if (!stored) break;
      const held = memory(state, m.node), old = held.get(`${m.session} ${from}`) ?? held.get(found(held, from));
      if (!old) break;
      old.photons -= Number(moved);
      if (old.photons <= 0) held.delete([...held].find(([, each]) => each === old)[0]);
      held.set(block(m), { photons: Number(moved), t: old.t });
      break;
    }
    case "recall":
    case "discard":
      memory(state, m.node).delete(block(m));
      break;
    case "tune":
      tune(state, m);
      break;
    case "fault":
      if (m.detail === "repaired") state.faulty.delete(m.node);
      else state.faulty.set(m.node, m.detail);
      decide(state, m.t, m.node, `fault: ${m.detail}`);
      break;
    case "dropped":
      state.missed += parseInt(m.detail);
      break;
  }
}

function flow(state, m) {
  if (!m.port) return;
  const photons = m.photons ?? 0, lost = m.lost ?? 0, number = Math.floor(m.t / BUCKET_S);
  const buckets = (state.flows.get(m.port)?.buckets ?? []).filter((each) => each.number > number - RATE_BUCKETS);
  const last = buckets.at(-1);
  if (last?.number === number) last.photons += photons, last.lost += lost;
  else buckets.push({ number, photons, lost });
  state.flows.set(m.port, { photons, lost, t: m.t, session: m.session, buckets });
}

// Photons that have come to a port in the last second, or were to come, and the part that was lost.
export function rate(state, port) {
  const first = Math.floor(state.t / BUCKET_S) - RATE_BUCKETS;
  const recent = (state.flows.get(port)?.buckets ?? []).filter((each) => each.number > first);
  const sum = (name) => recent.reduce((all, each) => all + each[name], 0);
  const photons = sum("photons") / (RATE_BUCKETS * BUCKET_S);
  return { photons, lost: photons ? sum("lost") / sum("photons") : 0 };
}

// A fibre's end: "q1:2", or "alice-q0", as ports of hosts have names of their own.
export function end(node, port) {
  return port.startsWith(`${node}-`) ? port : `${node}:${port}`;
}

function tune(state, m) {
  const tapped = m.detail?.match(TAPPED), lit = m.detail?.match(LIT);
  if (tapped) state.tapped.set(end(m.node, m.port), Number(tapped[1]));
  if (lit) state.classical.set(end(m.node, m.port), Number(lit[1]));
}

// The block of this number that has been stored longest: pairs of a link pass to another session.
function found(held, number) {
  return [...held.keys()].find((key) => key.endsWith(` ${number}`));
}

function block(m) {
  return `${m.session} ${m.block}/${m.half}`;
}

function memory(state, node) {
  if (!state.memories.has(node)) state.memories.set(node, new Map());
  return state.memories.get(node);
}

function bucket(state, t) {
  const number = Math.floor(t / BUCKET_S);
  if (!state.buckets.has(number)) {
    for (const old of state.buckets.keys()) {
      if (old >= number - WINDOW_S / BUCKET_S) break;
      state.buckets.delete(old);
    }
    state.buckets.set(number, { pairs: 0, arrived: 0, lost: 0 });
  }
  return state.buckets.get(number);
}

// Those go of which nothing has been heard for longest.
function forgetSessions(state) {
  const oldest = [...state.sessions.values()].sort((one, two) => one.last - two.last).slice(0, MOST_SESSIONS / 2);
  for (const each of oldest) state.sessions.delete(each.id);
}

function session(state, id, t) {
  if (!state.sessions.has(id)) {
    if (state.sessions.size >= MOST_SESSIONS) forgetSessions(state);
    state.sessions.set(id, {
      id, nodes: new Set(), says: "", since: t, last: t, pairs: 0, arrived: 0, lost: 0, measured: 0, told: {},
      estimates: {}, // what its ends have estimated: name -> {value, low, high} of 95 %
    });
  }
  const found = state.sessions.get(id);
  found.last = t;
  return found;
}

function controller(state, m, names) {
  if (m.event === "estimate") {
    session(state, m.session, m.t).estimates[m.quantity] = { value: m.value, low: m.low, high: m.high };
    return;
  }
  if (m.event === "key_link") {
    const others = state.keyLinks.filter((each) => each.from_ !== m.from_ || each.to !== m.to);
    state.keyLinks = [...others, m].sort((one, two) => `${one.from_} ${one.to}`.localeCompare(`${two.from_} ${two.to}`));
    return;
  }
  if (m.session) {
    const here = session(state, m.session, m.t);
    here.says = m.event === "refused" || m.event === "forbidden" ? `${m.event}: ${m.detail}` : m.event.replaceAll("_", " ");
    here.over = ENDED.has(m.event);
    if (m.setup_ms !== undefined) here.setup_ms = m.setup_ms;
  }
  if (m.event === "port") {
    const end = `${names[m.dpid] ?? m.dpid}:${m.at}`;
    if (m.up) state.cut.delete(end);
    else state.cut.add(end);
  }
  if (m.event === "device" && m.name) state.devices[m.name] = { ...state.devices[m.name], state: m.state };
  if (m.event !== "tuned" && m.event !== "fiber" && m.event !== "link") decide(state, m.t, "c0", words(m));
}

function words(m) {
  const { t, what, event, packet_in_count, ...rest } = m;
  const more = Object.entries(rest).map(([name, value]) => `${name} ${typeof value === "object" ? JSON.stringify(value) : value}`);
  return [event.replaceAll("_", " "), ...more].join(", ");
}

function act(state, m) {
  decide(state, m.t, "you", `${["qmn", ...m.command].join(" ")}: ${m.said || (m.status ? "failed" : "done")}`);
}

function decide(state, t, who, text) {
  state.decisions.push({ t, who, text });
  if (state.decisions.length > MOST_DECISIONS) state.decisions.shift();
}

function devices(state, m) {
  for (const device of m.devices) state.devices[device.name] = device;
  state.keyLinks = m.key_links ?? [];
  for (const told of m.sessions) session(state, told.session, m.t).told = told;
}

function job(state, m) {
  const { t, what, ...rest } = m;
  state.job = rest;
}

function fault(state, m) {
  decide(state, m.t, "qmn", m.text);
}
