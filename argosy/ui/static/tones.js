// Colours that people with any colour vision tell apart (Okabe and Ito), and signs that tell the same without colour.

const TONES = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b58900", "#3f8fd0", "#7a5195", "#5c6670"];
const places = new Map();

// The colour of a robot: the same on the map, in the list and in the chart.
export function toneOf(name) {
  if (!places.has(name)) places.set(name, places.size);
  return TONES[places.get(name) % TONES.length];
}

// Fix the order of colours, so that it does not depend on who is seen first.
export function nameTones(names) {
  for (const name of [...names].sort(byName)) if (!places.has(name)) places.set(name, places.size);
}

// uav2 before uav10
export function byName(one, other) {
  return one.localeCompare(other, "en", { numeric: true });
}

// Whether the daemon of an agent or robot is there.
export function isThere(one) {
  return one.standing !== "missing";
}

// How an agent is: [sign, class, word]
export function stateOf(agent) {
  if (!isThere(agent)) return ["✕", "gone", agent.since ? "gone" : "not there yet"];
  if (agent.silent) return ["?", "bad", "silent"];
  if (agent.standing === "silent") return ["?", "bad", "hangs"];
  if (agent.state === "paused") return ["❚❚", "warn", "paused"];
  if (agent.state === "reasoning") return ["▶", "good", "reasoning"];
  if (agent.state === "waiting") return ["◷", "calm", "waiting"];
  return ["…", "calm", "coming"];
}
