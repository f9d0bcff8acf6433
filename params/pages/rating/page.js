"use strict";
// Answers are kept in the browser after each click, so that a page that was closed goes on where it was.
const { rater, items } = JSON.parse(document.getElementById("items").textContent);
const key = `siren-rating-${rater}-${items.length ? items[0].id : ""}`;
const element = (id) => document.getElementById(id);
let answers = {};
let place = 0;

function remembered() {
  try {
    return JSON.parse(localStorage.getItem(key)) || {};
  } catch {
    return {};
  }
}

function remember() {
  try {
    localStorage.setItem(key, JSON.stringify(answers));
  } catch {
    element("progress").textContent = "This browser keeps nothing: save the answers before you close the page.";
  }
}

function taken(found) {
  answers = Object.fromEntries(items.filter(({ id }) => id in found).map(({ id }) => [id, found[id]]));
  place = items.findIndex(({ id }) => !(id in answers));
  show();
}

function show() {
  const done = Object.keys(answers).length;
  if (place < 0 || place >= items.length) place = items.length - 1;
  const whole = done === items.length ? " All are answered: save the file." : "";
  element("progress").textContent = `Video ${place + 1} of ${items.length}, ${done} answered.${whole}`;
  const { id, files } = items[place];
  const scene = element("scene");
  scene.className = files.length > 1 ? "frames" : "";
  scene.replaceChildren(...files.map((file) => {
    const part = document.createElement(files.length > 1 ? "img" : "video");
    part.src = file;
    if (files.length === 1) Object.assign(part, { controls: true, autoplay: true, muted: true });
    return part;
  }));
  for (const button of document.querySelectorAll("#choices button")) {
    button.setAttribute("aria-pressed", String(answers[id] === button.dataset.class));
  }
}

function choose(title) {
  answers[items[place].id] = title;
  remember();
  place = Math.min(place + 1, items.length - 1);
  show();
}

for (const button of document.querySelectorAll("#choices button")) {
  button.addEventListener("click", () => choose(button.dataset.class));
}
addEventListener("keydown", (event) => {
  const button = document.querySelectorAll("#choices button")[Number(event.key) - 1];
  if (button && !event.ctrlKey && !event.altKey && !event.metaKey) choose(button.dataset.class);
});
element("back").addEventListener("click", () => {
  place = Math.max(place - 1, 0);
  show();
});
element("save").addEventListener("click", () => {
  const link = document.createElement("a");
  const text = JSON.stringify({ rater, answers }, null, 1);
  link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
  link.download = `${rater}.json`;
  link.click();
});
element("load").addEventListener("change", async (event) => {
  const [file] = event.target.files;
  if (!file) return;
  const found = JSON.parse(await file.text());
  if (found.rater === rater) {
    taken({ ...answers, ...found.answers });
    remember();
  } else {
    element("progress").textContent = `This file is of ${found.rater}.`;
  }
});
taken(remembered());
