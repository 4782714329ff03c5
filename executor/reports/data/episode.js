// One episode: videos, steps and curves on one time axis with one cursor. The section itself is plain HTML.
"use strict";
const SVG = "http://www.w3.org/2000/svg";
const COLORS = ["--accent", "--bad", "--good", "--warn", "--soft", "--c6", "--c7"];
const WIDTH = 640, HEIGHT = 110, LEFT = 46, RIGHT = 8, TOP = 8, BOTTOM = 16;

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

function drawing(tag, attributes, text) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

const seconds = (value) => value === null || value === undefined ? "" : value.toFixed(1) + " s";

// The time of an episode: whoever shows it listens, whoever is used to choose it sets it.
class Clock {
  constructor(duration) { this.duration = duration; this.now = 0; this.listeners = []; }
  listen(listener) { this.listeners.push(listener); }
  set(time, source) {
    this.now = Math.min(Math.max(time, 0), this.duration);
    for (const listener of this.listeners) listener(this.now, source);
  }
}

function openEpisode(section) {
  const clock = new Clock(Number(section.dataset.duration));
  playVideos(section, clock);
  const cursor = section.querySelector(".timeline .cursor");
  if (cursor) clock.listen((now) => { cursor.style.left = 100 * now / clock.duration + "%"; });
  section.addEventListener("click", (event) => {
    const chosen = event.target.closest("[data-at]");
    if (!chosen) return;
    event.preventDefault();
    clock.set(Number(chosen.dataset.at));
    if (!chosen.matches(".to-step")) return;
    const step = section.querySelector("#" + chosen.hash.slice(1));
    step.open = true;
    step.scrollIntoView({ block: "nearest" });
  });
  const scene = section.querySelector("details.scene");
  if (scene) scene.addEventListener("toggle", () => {
    if (scene.open && !scene.querySelector("iframe")) scene.append(element("iframe", { src: scene.dataset.src, title: "the scene in 3-D" }));
  });
  const motion = JSON.parse(section.querySelector("script.motion").textContent);
  if (motion) section.querySelector(".plots").append(...[...motion.plots.map((plot) => plotOf(plot, motion.time_s, clock)), pathOf(motion, clock)].filter(Boolean));
  clock.set(Number(section.dataset.from));
}

function playVideos(section, clock) {
  const videos = [...section.querySelectorAll(".videos video")], player = section.querySelector(".player");
  if (!player) return;
  const clips = videos.map((video) => ({ speed: Number(video.dataset.speed), begin_s: Number(video.dataset.begin) }));
  videos.forEach((video) => { video.controls = false; video.muted = true; });
  const placeOf = (k, now) => clips[k].begin_s + now / clips[k].speed;
  const slider = element("input", { type: "range", min: 0, max: clock.duration, step: 0.05, value: 0, "aria-label": "time" });
  const label = element("span", { class: "soft time" }, seconds(0));
  const button = element("button", { type: "button" }, "Play");
  player.append(...(videos.length ? [button] : []), slider, label);
  slider.addEventListener("input", () => clock.set(Number(slider.value)));
  button.addEventListener("click", () => { if (videos[0].paused) start(); else stop(); });
  clock.listen((now, source) => {
    slider.value = now;
    label.textContent = seconds(now);
    if (source !== "video") videos.forEach((video, k) => { video.currentTime = placeOf(k, now); });
  });
  function start() {
    if (clock.now >= clock.duration - 0.1) clock.set(0);
    videos.forEach((video) => video.play());
    button.textContent = "Pause";
    requestAnimationFrame(follow);
  }
  function stop() { videos.forEach((video) => video.pause()); button.textContent = "Play"; }
  function follow() {
    if (videos[0].paused) { button.textContent = "Play"; return; }
    const now = (videos[0].currentTime - clips[0].begin_s) * clips[0].speed;
    videos.forEach((video, k) => {
      if (k && Math.abs(video.currentTime - placeOf(k, now)) > 0.2) video.currentTime = placeOf(k, now);
    });
    clock.set(now, "video");
    // A file of a data set goes on with the next episode.
    if (now >= clock.duration) stop(); else requestAnimationFrame(follow);
  }
}

function plotOf(plot, times, clock) {
  const lines = Object.entries(plot.lines);
  const values = lines.flatMap(([, line]) => line.filter((value) => value !== null));
  if (!values.length) return null;
  let low = Math.min(...values), high = Math.max(...values);
  if (high - low < 1e-9) { low -= 0.5; high += 0.5; }
  const x = (time) => LEFT + (WIDTH - LEFT - RIGHT) * time / clock.duration;
  const y = (value) => TOP + (HEIGHT - TOP - BOTTOM) * (high - value) / (high - low);
  const picture = drawing("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": plot.name });
  for (const value of [low, (low + high) / 2, high]) {
    picture.append(drawing("line", { x1: LEFT, x2: WIDTH - RIGHT, y1: y(value), y2: y(value), class: "grid" }));
    picture.append(drawing("text", { x: LEFT - 5, y: y(value) + 4, "text-anchor": "end" }, Number(value.toPrecision(3))));
  }
  lines.forEach(([, line], k) => {
    const path = line.map((value, i) => value === null ? null : `${line[i - 1] === null || i === 0 ? "M" : "L"}${x(times[i]).toFixed(1)} ${y(value).toFixed(1)}`);
    picture.append(drawing("path", { d: path.filter(Boolean).join(""), class: "curve", style: `stroke:var(${COLORS[k % COLORS.length]})` }));
  });
  const cursor = drawing("line", { x1: x(0), x2: x(0), y1: TOP, y2: HEIGHT - BOTTOM, class: "now" });
  picture.append(cursor);
  const legend = lines.map(([name], k) => [name, element("b", {}), k]);
  clock.listen((now) => {
    cursor.setAttribute("x1", x(now)); cursor.setAttribute("x2", x(now));
    const at = nearest(times, now);
    legend.forEach(([, shown, k]) => { const value = lines[k][1][at]; shown.textContent = value === null ? "" : " " + Number(value.toPrecision(3)); });
  });
  const choose = (event) => {
    const box = picture.getBoundingClientRect();
    const place = (event.clientX - box.left) / box.width * WIDTH;
    clock.set((place - LEFT) / (WIDTH - LEFT - RIGHT) * clock.duration);
  };
  picture.addEventListener("click", choose);
  picture.addEventListener("pointermove", (event) => { if (event.buttons) choose(event); });
  return element("figure", { class: "plot" },
    element("figcaption", {}, `${plot.name} [${plot.unit}] `, ...legend.map(([name, shown, k]) =>
      element("span", { style: `color:var(${COLORS[k % COLORS.length]})` }, name, shown))), picture);
}

function nearest(times, now) {
  let low = 0, high = times.length - 1;
  while (low < high) { const middle = (low + high) >> 1; if (times[middle] < now) low = middle + 1; else high = middle; }
  return low;
}

function pathOf(plots, clock) {
  const points = plots.base_m;
  if (points.length < 2) return null;
  const xs = points.map((point) => point[0]), ys = points.map((point) => point[1]);
  const low = [Math.min(...xs), Math.min(...ys)], size = Math.max(Math.max(...xs) - low[0], Math.max(...ys) - low[1], 0.2);
  const place = (point) => [10 + 180 * (point[0] - low[0]) / size, 190 - 180 * (point[1] - low[1]) / size];
  const picture = drawing("svg", { viewBox: "0 0 200 200", role: "img", "aria-label": "path of the base from above" });
  picture.append(drawing("polyline", { points: points.map((point) => place(point).map((one) => one.toFixed(1)).join(",")).join(" "), class: "curve", style: "stroke:var(--accent)" }));
  const [cx, cy] = place(points[0]);
  const dot = drawing("circle", { cx, cy, r: 4, class: "dot" });
  picture.append(dot);
  clock.listen((now) => { const [x, y] = place(points[nearest(plots.time_s, now)]); dot.setAttribute("cx", x); dot.setAttribute("cy", y); });
  return element("figure", { class: "plot path" }, element("figcaption", {}, `path of the base from above, ${size.toFixed(2)} m wide`), picture);
}

