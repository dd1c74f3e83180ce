// Light: photons on their way, rates by time and by port, cross-connects.

export const BUCKET_S = 0.1, WINDOW_S = 60; // of rates by time, and how many are kept
const RATE_BUCKETS = 10; // of a port, over which its rate is taken
const LONG_S = 0.2; // of a block: its own rate is that of its light
const GLOW_S = 1; // in which a light path that has closed is remembered: many last for milliseconds
const LONGEST_FLIGHT_S = 60; // of a block; those of which nothing has been heard for longer are lost

// Where light leaves or comes: the port of a host, or a part of a switch, whose ports have numbers.
const place = (m) => (/^\d+$/.test(m.port ?? "") ? m.node : m.port);

export function block(m) {
  return `${m.session} ${m.block}/${m.half}`;
}

export function send(state, m) {
  const port = place(m);
  if (port) state.flows.set(port, { photons: 0, lost: 0, buckets: [], took: 0, ...state.flows.get(port), t: m.t });
  state.flights.set(block(m), { t: m.t, port });
  const made = state.made.get(`${m.session} ${m.block}`);
  if (made) made.sent = true;
}

// A block has come as a whole; its photons came one after the other since it was sent.
export function arrive(state, m, here, goesOn) {
  const photons = m.photons ?? 0, lost = m.lost ?? 0;
  const flight = state.flights.get(block(m)), began = flight?.t ?? m.t, made = state.made.get(`${m.session} ${m.block}`);
  state.flights.delete(block(m));
  flow(state, m, m.t - began);
  if (!goesOn) spread(state, began, m.t, { arrived: photons - lost, lost });
  if (!made) return;
  here.came += made.pairs;
  here.began ??= made.t;
  state.made.delete(`${m.session} ${m.block}`);
  spread(state, made.t, made.t, { pairs: -made.pairs });
  spread(state, made.t, m.t, { pairs: made.pairs });
}

function spread(state, from, to, counts) {
  const last = Math.floor(to / BUCKET_S), first = Math.max(Math.floor(from / BUCKET_S), last - WINDOW_S / BUCKET_S);
  for (let number = first; number <= last; number++) {
    const each = bucket(state, number);
    for (const name in counts) each[name] += counts[name] / (last - first + 1);
  }
}

// Since when blocks are on their way of which nothing has come: of that time rates are not known yet.
export function unknownSince(state) {
  let since = Infinity;
  for (const [key, { t, sent }] of state.made) {
    if (state.t - t > LONGEST_FLIGHT_S) state.made.delete(key);
    else if (sent) since = Math.min(since, t);
  }
  return since;
}

function flow(state, m, took) {
  const port = place(m);
  if (!port) return;
  const photons = m.photons ?? 0, lost = m.lost ?? 0, number = Math.floor(m.t / BUCKET_S);
  const buckets = (state.flows.get(port)?.buckets ?? []).filter((each) => each.number > number - RATE_BUCKETS);
  const last = buckets.at(-1);
  if (last?.number === number) last.photons += photons, last.lost += lost;
  else buckets.push({ number, photons, lost });
  state.flows.set(port, { photons, lost, t: m.t, took, buckets });
}

// Photons a second that come to a port, or were to come, and the part that was lost: of the last
// second, or of the last block where that is a long one.
export function rate(state, port) {
  const flow = state.flows.get(port), window = RATE_BUCKETS * BUCKET_S;
  if (flow?.took > LONG_S) {
    const over = state.t - flow.t > 2 * flow.took;
    return over ? { photons: 0, lost: 0 } : { photons: flow.photons / flow.took, lost: flow.lost / (flow.photons || 1) };
  }
  const first = Math.floor(state.t / BUCKET_S) - RATE_BUCKETS;
  const recent = (flow?.buckets ?? []).filter((each) => each.number > first);
  const sum = (name) => recent.reduce((all, each) => all + each[name], 0);
  const photons = sum("photons") / window;
  return { photons, lost: photons ? sum("lost") / sum("photons") : 0 };
}

// Ports from which light is on its way.
export function sending(state) {
  const ports = new Set();
  for (const [key, { t, port }] of state.flights) {
    if (state.t - t > LONGEST_FLIGHT_S) state.flights.delete(key);
    else ports.add(port);
  }
  return ports;
}

export function close(state, port, t) {
  for (const [old, each] of state.closed) if (t - each.t > GLOW_S) state.closed.delete(old);
  if (state.ways.has(port)) state.closed.set(port, { to: state.ways.get(port), t });
  state.ways.delete(port);
}

// Where light leaves a switch that came in at a port, or did until just now.
export function wayFrom(state, port) {
  const recent = state.closed.get(port);
  return state.ways.get(port) ?? (recent && state.t - recent.t < GLOW_S ? recent.to : undefined);
}

export function bucket(state, number) {
  if (!state.buckets.has(number)) {
    for (const old of state.buckets.keys()) {
      if (old >= number - WINDOW_S / BUCKET_S) break;
      state.buckets.delete(old);
    }
    state.buckets.set(number, { pairs: 0, arrived: 0, lost: 0 });
  }
  return state.buckets.get(number);
}

export function forgetLight(light, session) {
  for (const key of light.keys()) if (key.startsWith(session)) light.delete(key);
}
