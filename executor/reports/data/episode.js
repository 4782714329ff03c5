// One episode: videos, steps and curves on one time axis with one cursor.
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
const badge = (words, tone) => element("span", { class: "badge " + tone }, words);

// The time of an episode: whoever shows it listens, whoever is used to choose it sets it.
class Clock {
  constructor(duration) { this.duration = duration; this.now = 0; this.listeners = []; }
  listen(listener) { this.listeners.push(listener); }
  set(time, source) {
    this.now = Math.min(Math.max(time, 0), this.duration);
    for (const listener of this.listeners) listener(this.now, source);
  }
}

function durationOf(detail) {
  const times = detail.plots ? detail.plots.time_s : [];
  const ends = detail.subtasks.flatMap((part) => part.steps.map((step) => step.end_s || 0));
  return Math.max(times.length ? times[times.length - 1] : 0, ...ends, detail.row.simulated_s || 0, 0.001);
}

function videosOf(clips, clock) {
  if (!clips.length) return null;
  const videos = clips.map((clip) => element("video", { src: clip.src, muted: true, playsinline: true, preload: "auto" }));
  videos.forEach((video) => { video.muted = true; });
  const timeOf = (video, clip) => (video.currentTime - clip.begin_s) * clip.speed;
  const slider = element("input", { type: "range", min: 0, max: clock.duration, step: 0.05, value: 0, "aria-label": "time" });
  const label = element("span", { class: "soft time" }, seconds(0));
  const button = element("button", { type: "button" }, "Play");
  slider.addEventListener("input", () => clock.set(Number(slider.value)));
  button.addEventListener("click", () => { if (videos[0].paused) start(); else stop(); });
  clock.listen((now, source) => {
    slider.value = now;
    label.textContent = seconds(now);
    if (source === "video") return;
    videos.forEach((video, k) => { video.currentTime = clips[k].begin_s + now / clips[k].speed; });
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
    const now = timeOf(videos[0], clips[0]);
    videos.forEach((video, k) => {
      if (k && Math.abs(timeOf(video, clips[k]) - now) > 0.2 * clips[k].speed) video.currentTime = clips[k].begin_s + now / clips[k].speed;
    });
    clock.set(now, "video");
    // A file of a data set goes on with the next episode.
    if (now >= clock.duration) stop(); else requestAnimationFrame(follow);
  }
  const figures = videos.map((video, k) => element("figure", {}, video, element("figcaption", { class: "soft" }, clips[k].name)));
  return element("div", { class: "card sticky" }, element("div", { class: "videos" }, ...figures),
    element("div", { class: "row" }, button, slider, label));
}

function timelineOf(detail, clock) {
  const bar = element("div", { class: "timeline", role: "img", "aria-label": "steps over time" });
  detail.subtasks.forEach((part, k) => part.steps.forEach((step, number) => {
    if (step.end_s === null || step.start_s === null) return;
    const left = 100 * step.start_s / clock.duration, width = 100 * (step.end_s - step.start_s) / clock.duration;
    const block = element("button", {
      type: "button", class: "block " + (step.failure ? "bad" : k % 2 ? "odd" : "even"),
      style: `left:${left}%;width:${Math.max(width, 0.3)}%`, title: `${k + 1}.${number + 1} ${step.text}`,
      onclick: () => { clock.set(step.start_s); const opened = document.getElementById(`step-${k}-${number}`); if (opened) { opened.open = true; opened.scrollIntoView({ block: "nearest" }); } },
    });
    bar.append(block);
  }));
  const cursor = element("i", { class: "cursor" });
  clock.listen((now) => { cursor.style.left = 100 * now / clock.duration + "%"; });
  bar.append(cursor);
  return bar;
}

function stepsOf(detail, clock) {
  return detail.subtasks.map((part, k) => {
    const state = part.succeeded === null ? badge("not run", "quiet") : part.succeeded ? badge("reached", "good") : badge("failed", "bad");
    const steps = part.steps.map((step, number) => element("details", { class: "step", id: `step-${k}-${number}`, open: Boolean(step.failure) },
      element("summary", {}, element("span", { class: "name" }, `${number + 1}. ${step.text}`),
        step.failure ? badge(step.failure[0], "bad") : null,
        step.start_s === null ? null : element("button", { type: "button", class: "time", title: "show this moment",
          onclick: (event) => { event.preventDefault(); clock.set(step.start_s); } }, `${step.start_s.toFixed(1)} to ${seconds(step.end_s)}`)),
      step.failure && step.failure[1] ? element("p", {}, step.failure[1]) : null,
      element("div", { class: "columns" }, facts("measured", step.measurements), facts("proved", step.needs))));
    return element("div", { class: "part" }, element("div", { class: "row" }, element("h3", {}, `${k + 1}. ${part.name}`), state),
      part.goal ? element("code", {}, part.goal) : null, ...steps);
  });
}

function facts(heading, rows) {
  if (!rows || !rows.length) return null;
  return element("div", {}, element("h4", {}, heading),
    element("table", {}, element("tbody", {}, ...rows.map(([name, value]) => element("tr", {}, element("td", {}, name), element("td", {}, value))))));
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

function episodeView(detail, sceneAddress) {
  const clock = new Clock(durationOf(detail)), row = detail.row;
  const plots = detail.plots ? detail.plots.plots.map((plot) => plotOf(plot, detail.plots.time_s, clock)).filter(Boolean) : [];
  const tone = row.ended === "succeeded" ? "good" : "bad";
  const views = element("div", {}, videosOf(detail.clips, clock), timelineOf(detail, clock),
    plots.length ? element("div", { class: "plots" }, ...plots, pathOf(detail.plots, clock)) : null);
  const made = element("div", { class: "episode" },
    element("h2", {}, row.task),
    element("div", { class: "row" }, detail.verdict ? badge(detail.verdict, detail.verdict === "proved" ? "good" : "warn") : null, badge(row.ended, tone),
      row.failure ? badge(row.failure, "bad") : null, element("span", { class: "soft" }, `${row.name}${row.seed === null ? "" : ", seed " + row.seed}${row.simulated_s ? ", " + seconds(row.simulated_s) + " simulated" : ""}`)),
    detail.message ? element("p", {}, detail.message) : null,
    element("div", { class: "beside" }, views, element("div", {}, ...stepsOf(detail, clock))),
    detail.scene && sceneAddress ? element("details", { class: "card", ontoggle: (event) => {
      if (event.target.open && !event.target.querySelector("iframe")) event.target.append(element("iframe", { src: sceneAddress, title: "the scene in 3-D" }));
    } }, element("summary", {}, "The scene in 3-D")) : null,
    detail.commands.length ? element("div", { class: "card" }, ...detail.commands.flatMap(([what, line]) => [element("p", { class: "soft" }, what), element("pre", {}, line)])) : null,
    detail.files.length ? element("p", { class: "row files" }, ...detail.files.map(([name, address]) => element("a", { href: address, download: true }, name))) : null);
  clock.set(0);
  return made;
}
