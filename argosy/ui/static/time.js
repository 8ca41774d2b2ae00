// Time as the page shows it: mission seconds of the fleet's clock. The time of day, and wall seconds, only where they are called so.

import { clock, span } from "./dom.js";

// Unix seconds at which what is shown holds: now, or when the run ended.
export function asOf(wire) {
  return wire.get("head")?.as_of ?? wire.now();
}

export function speedOf(wire) {
  return wire.get("head")?.speed ?? 1;
}

// Mission seconds at a time in Unix seconds; null = not known.
export function missionSeconds(wire, at) {
  const zero = wire.get("head")?.mission_zero ?? null;
  return zero === null ? null : Math.max(0, (at - zero) * speedOf(wire));
}

// How long ago that was, in mission time.
export function ago(wire, at) {
  return span((asOf(wire) - at) * speedOf(wire));
}

// Wall seconds, of what knows no mission time: routers and servers.
export function wall(wire, seconds) {
  return `${span(seconds)}${speedOf(wire) === 1 ? "" : " (wall)"}`;
}

// "34.5 s" of the mission, or the time of day as long as that is not known
export function moment(wire, at) {
  const seconds = missionSeconds(wire, at);
  return seconds === null ? `${clock(at)} (wall)` : `${seconds.toFixed(1)} s`;
}

// "2:05" of mission seconds
export function minutes(seconds) {
  return `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;
}
