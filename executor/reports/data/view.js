// The table of episodes: filters, order, selection, and the details of one.
"use strict";
const PAGE_ROWS = 30;
const SHORT_COMMAND = 100;  // Most names of a command that shows by itself; laying out thousands takes longer than the table.
const badge = (words, tone) => element("span", { class: "badge " + tone }, words);
const data = JSON.parse(document.getElementById("data").textContent);
const rows = data.rows.map((values) => Object.fromEntries(data.columns.map((name, k) => [name, values[k]])));
const at = (id) => document.getElementById(id);
const SHOWN = [["name", "name"], ["task", "task"], ["series", "series"], ["seed", "seed"], ["ended", "ended"], ["failure", "failure"],
  ["simulated_s", "time"], ["subtasks", "subtasks"], ["steps", "steps"], ["videos", "videos"], ["bytes", "size"], ["audited", "audit"]];
const columns = SHOWN.filter(([name]) => rows.some((row) => row[name] !== null && row[name] !== "" && row[name] !== 0));
const numeric = new Set(columns.map(([name]) => name).filter((name) => rows.some((row) => typeof row[name] === "number")));
const drawnNames = [...new Set(rows.flatMap((row) => Object.keys(row.drawn)))].sort();
const texts = rows.map((row) => `${row.name} ${row.task} ${row.series} ${row.failure}`.toLowerCase());
const state = { order: null, falling: false, count: PAGE_ROWS, matches: [] };

const selects = ["task", "series", "ended", "failure", "audited"].map((name) => {
  const values = [...new Set(rows.map((row) => row[name]))].filter(Boolean).sort();
  if (values.length < 2 && name !== "failure") return null;
  if (!values.length) return null;
  const select = element("select", { "aria-label": name, onchange: refresh }, element("option", { value: "" }, `any ${name}`),
    ...values.map((value) => element("option", { value }, value)));
  at("choices").append(select);
  return { name, select };
}).filter(Boolean);

const drawn = drawnNames.length ? {
  name: element("select", { "aria-label": "drawn value", onchange: refresh }, element("option", { value: "" }, "any drawn value"),
    ...drawnNames.map((name) => element("option", { value: name }, name))),
  low: element("input", { placeholder: "from", size: 6, "aria-label": "from", oninput: refresh }),
  high: element("input", { placeholder: "to", size: 6, "aria-label": "to", oninput: refresh }),
} : null;
if (drawn) at("drawn").append(drawn.name, drawn.low, drawn.high);
at("words").addEventListener("input", refresh);
at("filters").addEventListener("submit", (event) => event.preventDefault());
at("selected").addEventListener("toggle", writeCommand);
at("more").addEventListener("click", () => { state.count += 10 * PAGE_ROWS; fill(); });

at("table").tBodies[0].addEventListener("click", chooseRow);
at("table").tBodies[0].addEventListener("keydown", (event) => { if (event.key === "Enter") chooseRow(event); });

function inRange(row) {
  if (!drawn || !drawn.name.value) return true;
  const value = row.drawn[drawn.name.value], low = drawn.low.value.trim(), high = drawn.high.value.trim();
  if (value === undefined) return false;
  if (typeof value === "string") return !low || value.includes(low);
  return (low === "" || value >= Number(low)) && (high === "" || value <= Number(high));
}

function refresh() {
  const words = at("words").value.toLowerCase().split(/\s+/).filter(Boolean);
  const wanted = selects.filter(({ select }) => select.value);
  state.matches = rows.filter((row, k) => wanted.every(({ name, select }) => row[name] === select.value)
    && words.every((word) => texts[k].includes(word)) && inRange(row));
  if (state.order) {
    const sign = state.falling ? -1 : 1, value = (row) => state.order in row ? row[state.order] : row.drawn[state.order];
    const missing = (one) => one === null || one === undefined;
    state.matches.sort((a, b) => {
      const one = value(a), other = value(b);
      if (missing(one) || missing(other)) return missing(one) - missing(other);
      return sign * (one < other ? -1 : one > other ? 1 : 0);
    });
  }
  state.count = PAGE_ROWS;
  fill();
}

function fill() {
  const extra = drawn && drawn.name.value ? [[drawn.name.value, drawn.name.value]] : [];
  const all = [...columns, ...extra];
  at("table").tHead.replaceChildren(element("tr", {}, ...all.map(([name, title]) => element("th", { class: numeric.has(name) ? "n" : "", "aria-sort": state.order === name ? (state.falling ? "descending" : "ascending") : false },
    element("button", { type: "button", onclick: () => { state.falling = state.order === name && !state.falling; state.order = name; refresh(); } }, title)))));
  at("table").tBodies[0].replaceChildren(...state.matches.slice(0, state.count).map((row) => element("tr", { tabindex: 0, "data-name": row.name },
    ...all.map(([name]) => cell(row, name)))));
  at("more").hidden = state.matches.length <= state.count;
  const good = state.matches.filter((row) => row.ended === "succeeded").length;
  at("count").textContent = `${state.matches.length} of ${rows.length}; ${good} succeeded`;
  at("selected").hidden = !data.command || !state.matches.length || state.matches.length === rows.length;
  at("selected").open = state.matches.length <= SHORT_COMMAND;
  writeCommand();
}

function writeCommand() {
  const names = at("selected").open ? state.matches.map((row) => row.name).join("+") : "";
  at("selected").querySelector("pre").textContent = names && data.command.replace("{names}", () => names);
}

function cell(row, name) {
  if (name === "ended") return element("td", {}, badge(row.ended, row.ended === "succeeded" ? "good" : "bad"));
  const value = name in row ? row[name] : row.drawn[name];
  if (value === null || value === undefined || value === "") return element("td", {});
  if (name === "simulated_s") return element("td", { class: "n" }, seconds(value));
  if (name === "bytes") return element("td", { class: "n" }, value < 1e6 ? Math.ceil(value / 1e3) + " kB" : (value / 1e6).toFixed(1) + " MB");
  return element("td", typeof value === "number" ? { class: "n" } : {}, String(value));
}

function chooseRow(event) {
  const line = event.target.closest("tr");
  if (line) location.hash = encodeURIComponent(line.dataset.name);
}

async function open() {
  const name = decodeURIComponent(location.hash.slice(1)), section = at("detail");
  section.hidden = !name;
  at("overview").hidden = Boolean(name);
  if (!name) { section.replaceChildren(); return; }
  const back = rows.length > 1 ? element("button", { type: "button", onclick: () => { location.hash = ""; at("overview").scrollIntoView(); } }, "Back to the table") : null;
  section.replaceChildren(element("p", { class: "soft", role: "status" }, "reading"));
  try {
    const text = data.details ? data.details[name] : await fetched(name);
    if (!text) throw new Error(`There is no episode ${name}.`);
    const holder = element("div");
    holder.innerHTML = text;
    section.replaceChildren(...[back, holder].filter(Boolean));
    openEpisode(holder.querySelector(".episode"));
  } catch (problem) {
    section.replaceChildren(...[back, element("p", { class: "card bad" }, String(problem.message || problem))].filter(Boolean));
  }
  section.scrollIntoView();
}

async function fetched(name) {
  const answer = await fetch("/episode/" + encodeURIComponent(name));
  if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}: ${new DOMParser().parseFromString(await answer.text(), "text/html").body.textContent.trim()}`);
  return answer.text();
}

window.addEventListener("hashchange", open);
refresh();
if (rows.length === 1 && !location.hash) location.hash = encodeURIComponent(rows[0].name);
open();
