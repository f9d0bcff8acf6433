/** What needs no browser: poses between steps, another episode's actors, and addresses. */

import assert from "node:assert/strict";
import test from "node:test";
import type { Episode, Part } from "../src/episode";
import { readMoment } from "../src/link";
import { Other } from "../src/other";
import { latest } from "../src/sweeps";
import { newPose, Tracks } from "../src/tracks";

const STEP_S = 0.05;
const ABSENT = 255;

/** An episode of two cars that drive east, 10 m apart, with the columns that are given in place of those. */
function episode(columns: Record<string, number[]> = {}): Episode {
  const far = [0, 1, 2, 3, 10, 11, 12, 13];
  const known: Record<string, number[]> = { "frame.step": [0, 1, 2, 3], "motion.x_m": far, "1.frame.step": [0, 1, 2, 3], "1.motion.x_m": far };
  const column = (name: string) => columns[name] ?? known[name] ?? far.map(() => 0);
  const modes = [{ name: "nominal", colour: "", emv_colour: "#ff0000" }];
  const head = { step_s: STEP_S, scene: "", modes };
  return { head, numbers: (name: string) => Float64Array.from(column(name)), counts: (name: string) => Int32Array.from(column(name)) } as unknown as Episode;
}

function part(prefix: string, scene = ""): Part {
  const car = (id: number, name: string) => ({ id, name, class: "SEDAN", size_m: [4, 2, 1.5], rgb: 0, emv: id === 1, first: 0, frames: 4 });
  return { title: "", prefix, scene, actors: [car(1, "emv"), car(2, "car")], emvs: [1], left_hand: false, signals: {} } as Part;
}

function tracksOf(columns: Record<string, number[]> = {}): Tracks {
  return new Tracks(episode(columns), part(""));
}

test("between two steps an actor is on the straight line, and turns the shorter way", () => {
  const tracks = tracksOf({ "motion.yaw_rad": [3, -3, -3, -3, 0, 0, 0, 0] });
  const pose = newPose();
  tracks.setTime(0.25 * STEP_S);
  assert.ok(tracks.pose(0, pose));
  assert.ok(Math.abs(pose.x - 0.25) < 1e-9);
  assert.ok(Math.abs(pose.yaw - (3 + 0.25 * (2 * Math.PI - 6))) < 1e-9);
});

test("wheels roll backwards where an actor goes backwards", () => {
  const tracks = tracksOf({ "motion.x_m": [0, 2, 1, 1, 0, 0, 0, 0] });
  const pose = newPose();
  const rolled = [0, 1, 2, 3].map((step) => (tracks.setTime(step * STEP_S), tracks.pose(0, pose), pose.rolled));
  assert.deepEqual(rolled, [0, 2, 1, 1]);
});

test("an actor that is away for a step is not drawn into that step", () => {
  const tracks = tracksOf({ "motion.mode": [0, ABSENT, 0, 0, 0, 0, 0, 0] });
  const pose = newPose();
  tracks.setTime(0.5 * STEP_S);
  assert.ok(tracks.pose(0, pose));
  assert.equal(pose.x, 0);
  tracks.setTime(STEP_S);
  assert.ok(!tracks.pose(0, pose));
});

test("episodes first differ where an actor is elsewhere", () => {
  const columns = { "1.motion.x_m": [0, 1, 2, 3, 10, 11, 12.5, 14] };
  const other = new Other(episode(columns), part("1."), tracksOf(), 2);
  assert.deepEqual(other.difference, { frame: 2, index: 1 });
  assert.equal(other.apart(1, 3), 1);
  assert.equal(new Other(episode(), part("1."), tracksOf(), 2).difference, undefined);
  const late = { "1.motion.mode": [0, 0, 0, 0, 0, ABSENT, 0, 0] };
  assert.deepEqual(new Other(episode(late), part("1."), tracksOf(), 2).difference, { frame: 1, index: 1 });
});

test("nothing is far from a place on another map, or from one that is over", () => {
  const columns = { "1.motion.x_m": [5, 6, 7, 8, 15, 16, 17, 18] };
  assert.ok(Number.isNaN(new Other(episode(columns), part("1.", "1."), tracksOf(), 2).apart(0, 1)));
  const short = new Other(episode({ ...columns, "1.frame.step": [0, 1] }), part("1."), tracksOf(), 2);
  assert.equal(short.apart(0, 1), 5);
  assert.ok(Number.isNaN(short.apart(0, 2)));
});

test("an address gives what it has and can be understood", () => {
  assert.deepEqual(readMoment("#t=12.5&v=3&c=above&b=1"), { time: 12.5, actor: 3, camera: "above", beside: true });
  assert.deepEqual(readMoment("#t=&v=x&c=moon"), {});
});

test("the latest sweep is the last one at or before a time", () => {
  const times = [0.2, 0.4, 0.8];
  assert.deepEqual([0.1, 0.2, 0.39, 0.4, 0.3999999999, 9].map((time) => latest(times, time)), [-1, 0, 0, 1, 1, 2]);
});
