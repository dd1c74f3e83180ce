// The state of a network as messages tell it, one after the other. `apply` is all that changes it.

import { arrive, block, BUCKET_S, bucket, close, forgetLight, send } from "./light.js";
import { intercepted, note } from "./qkd.js";
import { decision, outcome } from "./words.js";

const GATHERED = /(\d+) of \d+ of (\d+\/\d+)/g;
const STORED = ", still stored", LET_GO = ", the rest let go";
const OUTCOME = /(?:Phi|Psi)[+-]=(\d+)/g;
const TAPPED = /^tapped (\S+)/, LIT = /^classical light (\S+)/;
const STANDARD_ERRORS = 1.96; // of an interval of 95 %
const MOST_DECISIONS = 300, MOST_SESSIONS = 300;
const ENDED = new Set(["torn_down", "refused", "forbidden"]);

export function blank() {
  return {
    t: 0,
    ways: new Map(), // "q1:2" -> "4": cross-connects that stand
    closed: new Map(), // the same -> {to, t}: those that have closed just now
    flights: new Map(), // "session block/half" -> {t, port}: light that is on its way
    made: new Map(), // "session block" -> {t, pairs}: of blocks of which nothing has come yet
    sessions: new Map(),
    memories: new Map(), // node -> Map of block -> {photons, t}
    flows: new Map(), // "alice-q0" -> {photons, lost, took} of the last light that came, its buckets, when some was there
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
    qkd: { points: [], last: null, failed: null }, // reports of key distribution
    eve: {}, // host -> {photons, measured, held}: what it has intercepted
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
      close(state, `${m.node}:${m.port}`, m.t);
      break;
    case "create":
      if (here) here.pairs += count;
      bucket(state, Math.floor(m.t / BUCKET_S)).pairs += count;
      if (m.session) state.made.set(`${m.session} ${m.block}`, { t: m.t, pairs: count });
      break;
    case "send":
      send(state, m);
      break;
    case "arrive": {
      const goesOn = m.node in state.eve; // light that an eavesdropper sends on has not arrived
      if (here && !goesOn) here.arrived += count, here.lost += m.lost ?? 0;
      arrive(state, m, here, goesOn);
      break;
    }
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
    case "gather":
      gather(state, m);
      break;
    case "recall":
    case "discard":
      memory(state, m.node).delete(block(m));
      break;
    case "resend":
    case "split":
      if (here && !(m.node in state.eve)) here.arrived -= count, here.lost -= m.lost ?? 0; // counted when it came
      intercepted(state, m);
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

// Photons of other blocks become one: they take their age with them, the rest stays or is let go.
function gather(state, m) {
  if (!m.detail.includes(STORED)) return;
  const held = memory(state, m.node);
  let oldest = Infinity;
  for (const [, moved, from] of m.detail.matchAll(GATHERED)) {
    const key = held.has(`${m.session} ${from}`) ? `${m.session} ${from}` : found(held, from), old = held.get(key);
    if (!old) continue;
    oldest = Math.min(oldest, old.t);
    old.photons -= Number(moved);
    if (old.photons <= 0 || m.detail.includes(LET_GO)) held.delete(key);
  }
  if (oldest < Infinity) held.set(block(m), { photons: m.photons ?? 0, t: oldest });
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

function memory(state, node) {
  if (!state.memories.has(node)) state.memories.set(node, new Map());
  return state.memories.get(node);
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
      id, nodes: new Set(), says: "", asked: {}, since: t, last: t, pairs: 0, came: 0, arrived: 0, lost: 0, measured: 0, report: {},
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
    here.says = outcome(m);
    // A session's second set-up message asks a source for its pairs.
    if (m.service && (!here.asked.service || m.service !== "pair_source")) here.asked = { from: m.from, to: m.to, service: m.service };
    here.over = ENDED.has(m.event);
    if (here.over) for (const light of [state.flights, state.made]) forgetLight(light, m.session);
    if (m.setup_ms !== undefined) here.setup_ms = m.setup_ms;
  }
  if (m.event === "port") {
    const end = `${names[m.dpid] ?? m.dpid}:${m.at}`;
    if (m.up) state.cut.delete(end);
    else state.cut.add(end);
  }
  if (m.event === "device" && m.name) state.devices[m.name] = { ...state.devices[m.name], state: m.state };
  const text = decision(m, names);
  if (text) decide(state, m.t, "c0", text);
}

function act(state, m) {
  decide(state, m.t, "you", `${["qmn", ...m.command].join(" ")}: ${m.output || (m.status ? "failed" : "done")}`);
}

function decide(state, t, who, text) {
  // Programs write each for itself: some come a moment behind what happened after them.
  let place = state.decisions.length;
  while (place > 0 && state.decisions[place - 1].t > t) place--;
  state.decisions.splice(place, 0, { t, who, text });
  if (state.decisions.length > MOST_DECISIONS) state.decisions.shift();
}

function devices(state, m) {
  for (const device of m.devices) state.devices[device.name] = device;
  state.keyLinks = m.key_links ?? [];
  for (const report of m.sessions) session(state, report.session, m.t).report = report;
}

function job(state, m) {
  const { t, what, ...rest } = m;
  state.job = rest.event === "failed" ? { ...state.job, ...rest } : rest;
  note(state, m);
  // A short run is over before its hosts report: the program's figure is of its one session.
  const own = [...state.sessions.values()].find((each) => each.asked.service);
  if (own && typeof m.fidelity === "number") own.estimates.fidelity = fidelity(m);
}

function fidelity(m) {
  const half = STANDARD_ERRORS * (m.fidelity_error ?? 0);
  return { value: m.fidelity, low: m.fidelity_low ?? m.fidelity - half, high: m.fidelity_high ?? m.fidelity + half };
}

function fault(state, m) {
  decide(state, m.t, "qmn", m.text);
}
