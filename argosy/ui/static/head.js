// The header: which fleet, whether the router and the server are there, mission time, and what stops all robots.

import { count, el, keyed, put, say } from "./dom.js";
import { confirmed } from "./confirm.js";
import { minutes, missionSeconds, wall } from "./time.js";
import { hasEnded, isThere } from "./tones.js";

const ORDERS = { hold: "hold", land: "land", rtl: "rtl", release: "release", pause: "pause", continue: "continue" };
const MEANING = {
  hold: "stay where it is; its actions fail, its agents act no more",
  land: "land here and now",
  rtl: "return to launch",
  release: "give it back to its agents",
  pause: "stay where it is; its actions are kept",
  continue: "go on with its actions after a pause",
};

export class Head {
  constructor(element, banners, actions) {
    this._banners = banners;
    this.name = el("span", { class: "fleet" });
    this.mission = el("span", { class: "dim mission" });
    this.router = el("span", { class: "chip", id: "router" });
    this.run = el("span", { class: "chip", id: "run" });
    this.time = el("span", { class: "chip time", title: "mission time" });
    this.done = el("span", { class: "chip done" });
    this.members = el("span", { class: "dim members" });
    this.stops = orderButtons(actions, null);
    element.append(
      el("img", { class: "logo", src: "/static/icon.svg", alt: "" }),
      this.name,
      this.mission,
      this.run,
      this.router,
      this.time,
      this.done,
      this.members,
      el("span", { class: "grow" }),
      el("span", { class: "stops all", role: "group", "aria-label": "orders to all robots" }, el("b", {}, "all robots"), ...this.stops),
    );
    this._actions = actions;
  }

  // `wrong` tells what else of the page could not be drawn.
  render(wire, wrong) {
    const head = wire.get("head");
    if (!head) return this._say([["bad", wire.problem]]);
    document.title = `${head.fleet || "Argosy"} · argosy`;
    say(this.name, head.fleet || "no fleet yet");
    say(this.mission, head.mission === head.fleet ? "" : head.mission ?? "");
    put(this.name, "title", head.file);
    put(this.mission, "title", head.file);
    const up = (head.router ?? "never") === "up" && !wire.problem, ended = head.router === "ended" && !wire.problem;
    const [sign, kind, word] = runState(head.run, (up || ended) && !head.run_silent);
    put(this.run, "hidden", !head.run);
    put(this.run, "class", `chip ${kind}`);
    say(this.run, `${sign} ${word}`);
    put(this.run, "title", head.run?.why || word);
    put(this.router, "class", `chip ${up ? "good" : ended ? "calm" : "bad"}`);
    say(this.router, wire.problem ? "? router" : up ? "● router" : ended ? "■ router ended" : `✕ router ${head.router === "away" ? "away" : "not reached"} ${wall(wire, wire.now() - head.router_since)}`);
    put(this.router, "title", wire.problem ? `${head.endpoint}: its state is not known while argosy ui does not answer` : head.endpoint);
    this._time(head, wire);
    const held = Object.entries(head.done ?? {});
    put(this.done, "hidden", held.length === 0);
    say(this.done, `${held.filter(([, holds]) => holds).length} of ${held.length} done`);
    put(this.done, "title", held.map(([formula, holds]) => `${holds ? "●" : "○"} ${formula}`).join("\n"));
    put(this.done, "class", held.length && held.every(([, holds]) => holds) ? "chip done good" : "chip done");
    const agents = wire.of("agent"), robots = wire.of("robot");
    const there = (all) => all.filter((one) => isThere(one) || hasEnded(one)).length;
    say(this.members, `${there(agents)}/${count(agents.length, "agent")}, ${there(robots)}/${count(robots.length, "robot")}`);
    for (const button of this.stops) allow(button, head.observer);
    this._say([...banners(head, wire, this._actions), ...wrong.map((text) => ["bad", text])]);
  }

  _time(head, wire) {
    // The clock stands while nobody tells the time.
    const until = wire.problem ? wire.now() - wire.silentFor : (head.router ?? "never") === "up" ? wire.now() : head.router_since;
    const seconds = isOver(head.run) ? head.run.mission_time ?? 0 : missionSeconds(wire, until);
    put(this.time, "hidden", seconds === null);
    if (seconds === null) return;
    const speed = head.speed ?? 1;
    say(this.time, `${minutes(seconds)}${head.timeout ? ` of ${Math.round(head.timeout / 60)} min` : ""}${speed === 1 ? "" : ` ×${speed}`}`);
  }

  _say(banners) {
    keyed(
      this._banners,
      banners.filter(([, text]) => text),
      ([, text, , key]) => key ?? text,
      ([level]) => el("div", { class: `banner ${level}` }, el("span", {}), el("span", { class: "choices" })),
      (node, [, text, choices]) => {
        say(node.firstChild, text);
        keyed(node.lastChild, choices ?? [], (one) => one.text, (one) => el("button", { on: { click: one.act } }, one.text));
      },
    );
  }
}

function banners(head, wire, actions) {
  const found = [];
  if (wire.problem) {
    found.push(["bad", `${wire.problem}. Below is what was known ${wall(wire, wire.silentFor)} ago`, null, "server"]);
  } else if (isOver(head.run)) {
    const { phase, why, mission_time: seconds = 0, report, recording } = head.run;
    const kept = [report && `Report: ${report}.`, recording && `Recording: ${recording}.`].filter(Boolean).join(" ");
    const text = phase === "done" ? `The mission is done after ${seconds.toFixed(1)} s.` : `The mission has failed after ${seconds.toFixed(1)} s: ${why || "see the report"}.`;
    found.push([phase === "done" ? "good" : "bad", `${text} ${kept}`, null, "run"]);
  } else if ((head.router ?? "never") !== "up") {
    const since = wall(wire, wire.now() - head.router_since);
    const text = head.router === "away" ? `The router at ${head.endpoint} is lost for ${since}; reconnecting. The last known state is shown` : `${head.problem} (for ${since}); trying again`;
    found.push(["bad", text, null, "router"]);
  } else if (head.fleets?.length) {
    const choices = head.fleets.map((fleet) => ({ text: fleet, act: () => actions.fleet(fleet) }));
    found.push(["calm", "Several fleets are on this router. Which one?", choices, "fleets"]);
  } else if (head.problem) {
    found.push(["warn", `${head.problem}`, null, "problem"]);
  } else if (!wire.of("agent").some(isThere) && !wire.of("robot").some(isThere)) {
    found.push(["warn", `No daemon of fleet ${head.fleet} is on the bus at ${head.endpoint} now`, null, "nobody"]);
  }
  const defect = wire.get("defect");
  if (defect) found.push(["bad", `${defect}. What is below is no longer updated`, null, "defect"]);
  if (head.run_silent && !wire.problem) found.push(["warn", `argosy run has not been heard for ${wall(wire, wire.now() - head.run_silent)}: nothing supervises this run now`, null, "watched"]);
  if (head.mission_differs) found.push(["warn", `The fleet runs another mission than ${head.mission_differs}, with which argosy ui was started: that of the fleet counts here`, null, "mission"]);
  for (const alarm of head.alarms ?? []) found.push(["bad", `${alarm.names.join(", ")}: ${alarm.text}`, null, `alarm ${noteKey(alarm)}`]);
  for (const line of head.unreached ?? []) found.push(["warn", line]);
  if (!isOver(head.run)) for (const [formula, holds] of Object.entries(head.failed ?? {})) if (holds) found.push(["bad", `The mission has failed: ${formula}`]);
  return found;
}

// The same as long as a warning of the same members holds, whatever its text becomes
export function noteKey({ code, about = "", names }) {
  return [code, about, ...names].join(" ");
}

const PHASES = {
  starting: ["…", "calm"],
  running: ["➤", "good"],
  bringing_home: ["⌂", "warn"],
  done: ["✓", "good"],
  failed: ["✕", "bad"],
};

// How a run is, as far as it is heard: [sign, class, word]
function runState(run, heard) {
  const phase = run?.phase ?? "starting";
  const [sign, kind] = PHASES[phase];
  const word = phase.replace("_", " ");
  return isOver(run) || heard ? [sign, kind, word] : [sign, "warn", `${word}?`];
}

export function isOver(run) {
  return run?.phase === "done" || run?.phase === "failed";
}

// The buttons of orders to one robot, or to all (robot null).
export function orderButtons(actions, robot) {
  return Object.entries(ORDERS).map(([order, text]) => {
    const title = `${order} ${robot ?? "all robots"}: ${MEANING[order]}. Press for 0.7 s, or click twice within 3 s`;
    const button = confirmed({ text, again: `${text}: sure?`, title, class: `order ${order}`, act: () => actions.stop(order, robot) });
    put(button, "data-order", order);
    put(button, "data-robot", robot ?? "all");
    return button;
  });
}

// A button that may not be used says why, and can still be reached.
export function allow(button, why) {
  put(button, "aria-disabled", why ? "true" : null);
  put(button, "data-why", why || null);
  put(button, "title", why || button.dataset.title);
}
