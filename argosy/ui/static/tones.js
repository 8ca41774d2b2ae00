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
  return one.standing !== "missing" && !hasEnded(one);
}

// Whether it has left with its run, which is no loss.
export function hasEnded(one) {
  return one.standing === "ended";
}

// Whether nobody knows of a robot how it is now, although its run was ended: it was armed when its bridge left.
export function isLeft(robot) {
  return hasEnded(robot) && Boolean(robot.armed);
}

// A call whose numbers have six digits behind the point at most: degrees to 0.1 m.
export function rounded(text) {
  return text.replace(/(\.\d{6})\d+/g, "$1");
}

// What an intention waits for (docs/reference/records.md, WaitView), to stand behind its state.
export function awaited(wait) {
  switch (wait?.kind) {
    case undefined: return "";
    case "action": return `for the action ${wait.name}`;
    case "answer": return `for the answer of ${(wait.agents ?? []).join(", ")}`;
    case "time": return `for ${wait.seconds ?? 0} s to pass (.wait)`;
    case "formula": return "for a condition to hold (.wait)";
    case "event": return "for an event to happen (.wait)";
    case "plan": return `for a plan for ${wait.name}`;
    case "goal_condition": return "for the condition of its goal to hold";
    case "fork": return "for the branches of its fork";
  }
  return `for ${wait.name}`;
}

// How an agent is: [sign, class, word]
export function stateOf(agent) {
  if (hasEnded(agent)) return ["■", "calm", "ended"];
  if (!isThere(agent)) return ["✕", "gone", agent.since ? "gone" : "not there yet"];
  if (agent.silent) return ["?", "bad", "silent"];
  if (agent.standing === "silent") return ["?", "bad", "hangs"];
  if (agent.state === "paused") return ["❚❚", "warn", "paused"];
  if (agent.state === "flying" || agent.state === "acting") return [agent.state === "flying" ? "➤" : "▸", "good", `${agent.state}: ${rounded(agent.action)}`];
  if (agent.state === "idle") return ["○", "calm", "idle"];
  if (agent.state === "reasoning") return ["▶", "good", "reasoning"];
  if (agent.state === "waiting") return ["◷", "calm", "waiting"];
  return ["…", "calm", "coming"];
}
