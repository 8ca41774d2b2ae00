// The list of agents with their robots: how each is, what it intends and does, and its stop buttons.

import { el, keyed, put, say, shortened } from "./dom.js";
import { allow, noteKey, orderButtons } from "./head.js";
import { ago } from "./time.js";
import { awaited, byName, hasEnded, isLeft, isThere, nameTones, rounded, stateOf, toneOf } from "./tones.js";

const SORTS = { name: "by name", trouble: "trouble first" };

export class Agents {
  constructor(element, actions) {
    this._actions = actions;
    this.search = el("input", { type: "search", id: "search", placeholder: "find: name, state, goal, mode …", "aria-label": "find agents and robots", on: { input: () => this.render(this._wire, this._selected) } });
    this.sort = el("select", { "aria-label": "order of the list", on: { change: () => this.render(this._wire, this._selected) } }, Object.entries(SORTS).map(([key, text]) => el("option", { value: key }, text)));
    this.list = el("ul", { class: "rows", role: "listbox", "aria-label": "agents" });
    this.none = el("p", { class: "empty" });
    this.shared = el("ul", { class: "plain shared notes data", "aria-label": "notes about several" });
    element.append(el("div", { class: "bar" }, this.search, this.sort), el("div", { class: "scroll" }, this.list, this.none, this.shared));
    this.list.addEventListener("keydown", (event) => this._move(event));
  }

  render(wire, selected) {
    if (!wire) return;
    this._wire = wire;
    this._selected = selected;
    const rows = rowsOf(wire);
    const words = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const shown = rows.filter((row) => words.every((word) => row.words.includes(word)));
    if (this.sort.value === "trouble") shown.sort((one, other) => other.trouble - one.trouble);
    keyed(this.list, shown, (row) => row.key, (row) => this._make(row), (node, row) => this._update(node, row, wire));
    keyed(this.shared, wire.get("head")?.notes ?? [], noteKey, () => el("li", {}), (node, one) => say(node, `⚠ ${one.names.join(", ")}: ${one.text}`));
    say(this.none, rows.length === 0 ? "no agent and no robot yet" : shown.length === 0 ? "nothing matches" : "");
  }

  _make(row) {
    const node = el("li", { class: "row", role: "option", tabindex: "0", "data-agent": row.agent?.name, "data-robot": row.robot?.name });
    const part = (name, ...more) => (node[name] = el("span", { class: name }, ...more));
    node.buttons = row.robot ? orderButtons(this._actions, row.robot.name) : [];
    node.append(
      el("div", { class: "line" }, part("sign"), part("who"), part("state"), part("counts")),
      (node.goal = el("div", { class: "goal data" })),
      (node.doing = el("div", { class: "doing data" })),
      (node.vehicle = el("div", { class: "line vehicle" }, part("dot"), part("robot"), part("how"), el("span", { class: "grow" }), el("span", { class: "stops", role: "group", "aria-label": `orders to ${row.robot?.name}` }, ...node.buttons))),
      (node.notes = el("div", { class: "notes data" })),
    );
    const select = () => this._actions.select(node.dataset.agent ?? null, node.dataset.robot ?? null);
    node.addEventListener("click", select);
    node.addEventListener("keydown", (event) => {
      if (event.target === node && (event.key === "Enter" || event.key === " ")) {
        event.preventDefault();
        select();
      }
    });
    return node;
  }

  _update(node, { agent, robot }, wire) {
    put(node, "aria-selected", agent && agent.name === this._selected ? "true" : "false");
    const [sign, kind, word] = agent ? stateOf(agent) : ["◇", !isThere(robot) && !hasEnded(robot) ? "gone" : "calm", "no agent seen"];
    say(node.sign, sign);
    put(node.sign, "class", `sign ${kind}`);
    say(node.who, agent?.name ?? robot.name);
    say(node.state, word + (agent?.silent ? ` ${ago(wire, agent.silent)}` : agent?.stale ? `, seen ${ago(wire, agent.stale)} ago` : ""));
    put(node.state, "title", word);
    put(node.state, "class", `state ${kind}`);
    say(node.counts, agent && agent.state ? counts(agent) : "");
    put(node.counts, "title", agent ? `${agent.belief_count ?? 0} beliefs, ${agent.event_count ?? 0} events wait, ${agent.mailbox ?? 0} messages wait` : null);
    const top = agent?.intentions?.[0];
    say(node.goal, top ? `${goalOf(top)}${(agent.intention_count ?? 0) > 1 ? `  +${agent.intention_count - 1}` : ""}` : "");
    put(node.goal, "title", (agent?.intentions ?? []).map((one) => `${goalOf(one)}  ${one.state} ${awaited(one.waits_for)} ${one.at ?? ""}`).join("\n") || null);
    const action = agent?.actions?.at(-1);
    const named = action && action.text === agent.action ? "" : `▸ ${shortened(rounded(action?.text ?? ""), 60)} `; // else the state names it
    say(node.doing, action ? `${named}for ${ago(wire, action.began)}${action.silent ? `, not heard of for ${ago(wire, action.silent)}` : progress(action)}` : "");
    put(node.doing, "data-silent", Boolean(action?.silent));
    put(node.doing, "title", action ? `${action.text} ${action.state}` : null);
    put(node.vehicle, "hidden", !robot);
    if (robot) this._vehicle(node, robot, wire);
    const all = [...(agent?.notes ?? []), ...(robot?.notes ?? [])];
    const alarms = all.filter((one) => one.level === "error"); // first: what is cut off at the end of the line is not seen
    const notes = [...alarms, ...all.filter((one) => one.level !== "error")].map((one) => one.text);
    say(node.notes, notes.length ? `⚠ ${notes.join(" · ")}` : "");
    put(node.notes, "class", `notes data${alarms.length ? " bad" : ""}`);
    put(node.notes, "title", notes.join("\n"));
    put(node, "class", `row${agent?.stale || robot?.stale ? " stale" : ""}${kind === "gone" ? " gone" : ""}`);
  }

  _vehicle(node, robot, wire) {
    node.dot.style.setProperty("--tone", toneOf(robot.name));
    say(node.robot, robot.name);
    const state = how(robot, wire);
    say(node.how, state);
    put(node.how, "class", `how data ${howClass(robot)}`);
    put(node.how, "title", state);
    for (const button of node.buttons) allow(button, wire.get("head")?.observer);
  }

  _move(event) {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!step || !event.target.classList.contains("row")) return;
    event.preventDefault();
    (step > 0 ? event.target.nextElementSibling : event.target.previousElementSibling)?.focus();
  }
}

function goalOf(intention) {
  return intention.stack?.[0] ?? "";
}

function counts(agent) {
  const parts = [];
  if (agent.event_count) parts.push(`${agent.event_count} ev`);
  if (agent.mailbox) parts.push(`${agent.mailbox} mail`);
  if (agent.question_count) parts.push(`${agent.question_count} asked`);
  if (agent.dropped) parts.push(`${agent.dropped} dropped`);
  return parts.join(" ");
}

// ", distance 31.2, speed 4.9"
function progress(action) {
  return Object.entries(action.feedback ?? {}).map(([name, value]) => `, ${name} ${value.toFixed(1)}`).join("");
}

export function howClass(robot) {
  return robot.lost || isLeft(robot) || !(isThere(robot) || hasEnded(robot)) ? "bad" : robot.operator || robot.paused || robot.stale ? "warn" : "";
}

// "GUIDED armed 20.1 m 87 %"
export function how(robot, wire) {
  if (!isThere(robot) && !hasEnded(robot)) return robot.since ? `bridge gone ${ago(wire, robot.since)}` : "no bridge yet";
  const parts = [];
  if (robot.operator) parts.push(`OPERATOR: ${robot.operator}`);
  if (robot.paused) parts.push("PAUSED");
  if (robot.lost) parts.push("LOST");
  if (isLeft(robot)) parts.push("when its bridge ended:");
  if (robot.stale) parts.push(`${ago(wire, robot.stale)} ago:`);
  if (robot.mode) parts.push(robot.mode, robot.armed ? "armed" : "disarmed");
  if (robot.altitude !== undefined) parts.push(`${robot.altitude.toFixed(1)} m`);
  if (robot.battery !== undefined) parts.push(`${robot.battery} %`);
  if (!robot.mode) parts.push(...Object.values(robot.reported ?? {}).slice(0, 3));
  return parts.join(" ") || "nothing reported yet";
}

function rowsOf(wire) {
  const robots = new Map(wire.of("robot").map((robot) => [robot.name, robot]));
  nameTones(robots.keys());
  const rows = wire.of("agent").map((agent) => {
    const robot = robots.get(agent.robot) ?? null;
    // A row is made for its robot, with that one's orders: with another robot it is another row.
    return { key: `agent ${agent.name} ${robot?.name ?? ""}`, agent, robot };
  });
  const taken = new Set(rows.map((row) => row.robot?.name));
  for (const robot of robots.values()) if (!taken.has(robot.name)) rows.push({ key: `robot ${robot.name}`, agent: null, robot });
  for (const row of rows) {
    const state = row.agent ? stateOf(row.agent) : ["", "", ""];
    row.trouble = ["bad", "gone"].includes(state[1]) ? 3 : row.robot?.lost || row.robot?.operator || row.robot?.paused ? 2 : row.agent?.dropped || state[1] === "warn" ? 1 : 0;
    row.words = JSON.stringify([row.agent?.name, row.robot?.name, state[2], row.robot?.mode, row.robot?.armed ? "armed" : "disarmed", row.agent?.intentions?.map(goalOf), row.agent?.board, row.robot?.operator, row.robot?.paused ? "paused" : ""]).toLowerCase();
  }
  return rows.sort((one, other) => byName(one.agent?.name ?? one.robot.name, other.agent?.name ?? other.robot.name));
}
