// The header: which fleet, whether the router and the server are there, mission time, and what stops all robots.

import { count, el, keyed, put, say, span } from "./dom.js";
import { confirmed } from "./confirm.js";
import { isThere } from "./tones.js";

const ORDERS = { hold: "hold", land: "land", rtl: "rtl", release: "release" };
const MEANING = {
  hold: "stay where it is; its agents act no more",
  land: "land here and now",
  rtl: "return to launch",
  release: "give it back to its agents",
};

export class Head {
  constructor(element, banners, actions) {
    this._banners = banners;
    this.name = el("span", { class: "fleet" });
    this.mission = el("span", { class: "dim mission" });
    this.router = el("span", { class: "chip", id: "router" });
    this.time = el("span", { class: "chip time", title: "mission time" });
    this.done = el("span", { class: "chip done" });
    this.members = el("span", { class: "dim members" });
    this.stops = orderButtons(actions, null);
    element.append(
      el("img", { class: "logo", src: "/static/icon.svg", alt: "" }),
      this.name,
      this.mission,
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
    say(this.mission, head.mission || "");
    put(this.mission, "title", head.file);
    const up = (head.router ?? "never") === "up" && !wire.problem;
    put(this.router, "class", `chip ${up ? "good" : "bad"}`);
    say(this.router, wire.problem ? "? router" : up ? "● router" : `✕ router ${head.router === "away" ? "away" : "not reached"} ${span(wire.now() - head.router_since)}`);
    put(this.router, "title", wire.problem ? `${head.endpoint}: nothing is known of it while argosy ui is not there` : head.endpoint);
    this._time(head, wire);
    const held = Object.entries(head.done ?? {});
    put(this.done, "hidden", held.length === 0);
    say(this.done, `${held.filter(([, holds]) => holds).length} of ${held.length} done`);
    put(this.done, "title", held.map(([formula, holds]) => `${holds ? "●" : "○"} ${formula}`).join("\n"));
    put(this.done, "class", held.length && held.every(([, holds]) => holds) ? "chip done good" : "chip done");
    const agents = wire.of("agent"), robots = wire.of("robot");
    const there = (all) => all.filter(isThere).length;
    say(this.members, `${there(agents)}/${count(agents.length, "agent")}, ${there(robots)}/${count(robots.length, "robot")}`);
    for (const button of this.stops) allow(button, head.observer);
    this._say([...banners(head, wire, this._actions), ...wrong.map((text) => ["bad", text])]);
  }

  _time(head, wire) {
    const zero = head.mission_zero ?? null;
    put(this.time, "hidden", zero === null);
    if (zero === null) return;
    const speed = head.speed ?? 1;
    // The clock stands while nobody tells the time.
    const until = wire.problem ? wire.now() - wire.silentFor : (head.router ?? "never") === "up" ? wire.now() : head.router_since;
    const seconds = Math.max(0, (until - zero) * speed);
    const text = `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;
    say(this.time, `${text}${head.timeout ? ` of ${Math.round(head.timeout / 60)} min` : ""}${speed === 1 ? "" : ` ×${speed}`}`);
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
    found.push(["bad", `${wire.problem}. Below is what was known ${span(wire.silentFor)} ago`, null, "server"]);
  } else if ((head.router ?? "never") !== "up") {
    const since = span(wire.now() - head.router_since);
    const text = head.router === "away" ? `The router at ${head.endpoint} is lost for ${since}; it is tried for. Below is what was known last` : `${head.problem} (for ${since}); it is tried again`;
    found.push(["bad", text, null, "router"]);
  } else if (head.fleets?.length) {
    const choices = head.fleets.map((fleet) => ({ text: fleet, act: () => actions.fleet(fleet) }));
    found.push(["calm", "Several fleets are on this router. Which one?", choices, "fleets"]);
  } else if (head.problem) {
    found.push(["warn", `${head.problem}`, null, "problem"]);
  } else if (!wire.of("agent").some(isThere) && !wire.of("robot").some(isThere)) {
    found.push(["warn", `Nobody of fleet ${head.fleet} is on the bus at ${head.endpoint} now`, null, "nobody"]);
  }
  const defect = wire.get("defect");
  if (defect) found.push(["bad", `${defect.text}. What is below does not change any more`, null, "defect"]);
  for (const line of head.unreached ?? []) found.push(["warn", line]);
  for (const [formula, holds] of Object.entries(head.failed ?? {})) if (holds) found.push(["bad", `The mission has failed: ${formula}`]);
  return found;
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
