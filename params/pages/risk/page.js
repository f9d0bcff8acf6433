"use strict";
const cards = [...document.querySelectorAll(".card")];
const filter = document.getElementById("filter");

function matches(card, wanted) {
  const right = card.dataset.right.split(" ").includes(wanted.get("model"));
  return (!wanted.get("label") || card.dataset.label === wanted.get("label"))
    && (!wanted.get("template") || card.dataset.template === wanted.get("template"))
    && (!wanted.get("verdict") || right === (wanted.get("verdict") === "right"));
}

function show() {
  const wanted = new FormData(filter);
  let shown = 0;
  for (const card of cards) {
    card.hidden = !matches(card, wanted);
    if (card.hidden) card.querySelector("video")?.pause();
    else shown += 1;
  }
  document.getElementById("shown").textContent = `${shown} of ${cards.length}`;
  document.getElementById("nothing").hidden = shown > 0;
}

for (const card of cards) {
  const video = card.querySelector("video");
  if (!video) continue;
  const length = Number(card.dataset.length);
  const marks = [...card.querySelectorAll("line.now")];
  const follow = () => {
    for (const mark of marks) {
      const x = String(video.currentTime / length * Number(mark.parentNode.querySelector(".frame").getAttribute("width")));
      mark.setAttribute("x1", x);
      mark.setAttribute("x2", x);
      mark.style.opacity = "1";
    }
    if (!video.paused) requestAnimationFrame(follow);
  };
  video.addEventListener("play", follow);
  video.addEventListener("seeked", follow);
  card.querySelector("button")?.addEventListener("click", event => {
    video.currentTime = Number(event.target.dataset.seek);
    video.play();
  });
  for (const chart of card.querySelectorAll("svg")) {
    chart.addEventListener("click", event => {
      const frame = chart.querySelector(".frame").getBoundingClientRect();
      video.currentTime = Math.min(Math.max((event.clientX - frame.left) / frame.width, 0), 0.999) * length;
    });
  }
}

filter.addEventListener("change", show);
filter.addEventListener("submit", event => event.preventDefault());
show();
