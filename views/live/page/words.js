// Values and facts of the controller in words, with units.

const UNITS = [
  ["per_s", "/s"], ["mhz", "MHz"], ["hz", "Hz"], ["dbm", "dBm"], ["db", "dB"], ["ms", "ms"], ["s", "s"], ["km", "km"],
  ["mw", "mW"], ["ma", "mA"], ["c", "°C"], ["pm", "pm"], ["nm", "nm"], ["ppm", "ppm"],
];
const SCALES = [[1e12, "THz"], [1e9, "GHz"], [1e6, "MHz"], [1e3, "kHz"], [1, "Hz"]];

const MOST_PATHS = 4; // of a session, in words: a chain of switches has a path for each half of each pair
export const reasons = {}; // why the controller has refused, by name

export const plain = (text) => String(text).replaceAll("_", " ");

// The name of a field, and its value with the unit at the end of that name.
export function quantity(name, value) {
  const [end, unit] = UNITS.find(([each]) => name.endsWith(`_${each}`)) ?? ["", ""];
  if (typeof value === "boolean") return [plain(name), value ? "yes" : "no"];
  if (typeof value !== "number" || !unit) return [plain(name), typeof value === "number" ? digits(value) : plain(value)];
  const called = plain(name.slice(0, -end.length - 1));
  return [called, unit.endsWith("Hz") ? frequency(value * (unit === "MHz" ? 1e6 : 1)) : `${digits(value)}${unit[0] === "/" ? "" : " "}${unit}`];
}

function frequency(hz) {
  const [scale, unit] = SCALES.find(([each]) => hz >= each) ?? [1, "Hz"];
  return `${digits(hz / scale)} ${unit}`;
}

export function digits(number, significant = 6) {
  return number.toLocaleString("en", { maximumSignificantDigits: significant });
}

// A time since the beginning: short runs have milliseconds.
export function moment(t) {
  return t && t < 0.1 ? `${(1000 * t).toFixed(3)} ms` : `${t.toFixed(3)} s`;
}

// The state of a session, as a fact about it tells.
export function outcome(m) {
  if (m.event === "torn_down") return "ended";
  return m.event === "refused" || m.event === "forbidden" ? `${m.event}: ${m.detail}` : plain(m.event);
}

const who = (m) => (m.from ? `${m.from} → ${m.to}, ${plain(m.service)}` : m.session ? "" : plain(m.detail ?? ""));
const about = (m) => (m.session ? `session ${m.session.slice(-6)}` : "");

function light(paths) {
  const shown = paths.slice(0, MOST_PATHS).map(({ begin, end, by, loss_db }) => `${begin} → ${end} by ${by.join(", ")} (${digits(loss_db)} dB)`);
  if (paths.length > MOST_PATHS) shown.push(`${paths.length - MOST_PATHS} more`);
  return "light of least loss: " + shown.join(" and ");
}

// Which quantum switches have seen the set-up themselves by then.
function copies(after) {
  return Object.entries(after ?? {}).map(([name, ms]) => (ms === null ? `not seen by ${name}` : `seen by ${name} ${digits(ms)} ms after c0`)).join(", ");
}

// A reason with its explanation: its name comes first, and perhaps what is in the way.
function why(detail) {
  const name = /^[A-Z_]+/.exec(detail ?? "")?.[0];
  const explained = reasons[name];
  return explained && !detail.includes(":") ? `${detail}: ${explained}` : detail ?? "";
}

const TEXTS = {
  switch: (m, names) => `${m.kind} switch ${names[m.dpid] ?? m.dpid} connected`,
  device: (m) => (m.state ? `${m.name} ${m.state === "heard" ? "connected" : `is ${m.state}`}` : ""), // of a port "port" tells, too
  port: (m, names) => `fibre at ${names[m.dpid] ?? m.dpid} port ${m.at}: ${m.up ? "whole" : "cut"}`,
  path_ready: (m) => `light path of ${about(m)} stands after ${digits(m.setup_ms)} ms`,
  moved: (m) => `light of ${about(m)} has moved within ${digits(m.setup_ms)} ms${m.light ? `: ${light(m.light)}` : ""}`,
  granted: (m) => `granted: ${[about(m), who(m), m.light?.length ? light(m.light) : "", copies(m.copies_ms)].filter(Boolean).join("; ")}`,
  copy_late: (m) => `${m.switch} has seen the set-up of ${about(m)} late, ${digits(m.setup_ms)} ms after c0`,
  refused: (m) => `refused: ${[about(m), who(m), why(m.detail)].filter(Boolean).join("; ")}`,
  forbidden: (m) => `forbidden by the policy: ${[about(m), who(m), m.detail].filter(Boolean).join("; ")}`,
  light_after: (m) => `has light now: ${about(m)}, which waited for session ${m.after.session.slice(-6)} to give it back`,
  queued: (m) => `waits for light: ${[about(m), who(m)].filter(Boolean).join("; ")}`,
  torn_down: (m) => `ended: ${about(m)}; ${{ FIN: "its connection was closed", RST: "its connection was broken off" }[m.detail] ?? m.detail}`,
  override: ({ name, t, what, event, ...settings }) =>
    `${name} shall use ${Object.entries(settings).map(([key, value]) => quantity(key, value ?? "default").join(" ")).join(", ")}`,
  policy: (m) => `the policy is in force${m.path ? `: ${m.path}` : ""}`,
};
const WITHOUT_TEXT = new Set(["tuned", "fiber", "link"]); // what it has found of the network, and port by port

// A decision or observation of the controller, and its reason; nothing for other facts.
export function decision(m, names) {
  if (WITHOUT_TEXT.has(m.event)) return "";
  return TEXTS[m.event]?.(m, names) ?? other(m);
}

function other(m) {
  const { t, what, event, session, packet_in_count, ...rest } = m;
  const more = Object.entries(rest).map(([name, value]) =>
    typeof value === "object" ? `${plain(name)} ${JSON.stringify(value)}` : quantity(name, value).join(" "));
  return [plain(event), about(m), ...more].filter(Boolean).join(", ");
}
