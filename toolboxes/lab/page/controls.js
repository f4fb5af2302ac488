// Controls for numbers and parts of an experiment: a slider for the usual range, a field for any allowed value.

import {baseValue, choices, SEED, structureOf, valueOf} from "./experiment.js";
import {digits, plain, unitHtml, unitText} from "./numbers.js";
import {SLIDER_STEPS, sliderRange, toPosition, toValue} from "./range.js";
import {label, OPEN, sections} from "./sections.js";

export class Controls {
  // onValue(key, number), onSetting(key, choice), onReset(key)
  constructor(holder, catalogue, {onValue, onSetting, onReset}) {
    Object.assign(this, {holder, catalogue, onValue, onSetting, onReset, structure: "", rows: new Map()});
  }

  // `inHeader`: keys of choices that are in the header instead.
  show(experiment, inHeader) {
    this.experiment = experiment;
    const structure = structureOf(this.catalogue, experiment);
    if (structure.id !== this.structure) this.#build(structure, inHeader);
    this.structure = structure.id;
    for (const row of this.rows.values()) row();
    for (const section of this.holder.querySelectorAll("details")) {
      section.querySelector("small").textContent = counted(section.querySelectorAll(".changed").length);
    }
  }

  #build(structure, inHeader) {
    const open = new Map([...this.holder.querySelectorAll("details")].map((section) => [section.dataset.heading, section.open]));
    const options = new Map([...choices(this.catalogue)].filter(([key]) => !inHeader.includes(key)));
    const numbers = [...structure.parameters, SEED];
    const focused = this.holder.contains(document.activeElement) ? document.activeElement.id : "";
    this.rows.clear();
    this.holder.replaceChildren(...sections([...options.keys(), ...numbers.filter((key) => !options.has(key))], this.catalogue).map(([heading, keys]) => {
      const section = document.createElement("details");
      section.dataset.heading = heading;
      section.open = open.get(heading) ?? OPEN.has(heading);
      section.innerHTML = `<summary><h2>${heading}</h2><small></small></summary>`;
      section.append(...keys.map((key) => options.has(key) ? this.#choice(key, options.get(key)) : this.#number(key)));
      return section;
    }));
    if (focused) document.getElementById(focused)?.focus();
  }

  #row(key) {
    const about = this.catalogue.keys[key] ?? {meaning: key};
    const row = document.createElement("div");
    row.className = "row";
    row.dataset.key = key;
    row.dataset.words = `${key} ${about.meaning}`.toLowerCase().replaceAll("_", " ");
    row.innerHTML = `<label title="${escaped(about.meaning)}">${label(key)}</label>`;
    return [row, about];
  }

  #number(key) {
    const [row, about] = this.#row(key), id = `key-${key.replaceAll(".", "-")}`;
    if (about.kind === "switch") return this.#switch(key, row, id);
    if (about.kind === "choice") return this.#select(row, id, about.choices, (index) => this.onValue(key, index),
      () => [valueOf(this.catalogue, this.experiment, key), key in this.experiment.values], key);
    row.insertAdjacentHTML("beforeend", `<input type="range" min="0" max="${SLIDER_STEPS}" step="1" aria-label="${escaped(about.meaning)}">
      <input type="text" inputmode="decimal" id="${id}" autocomplete="off" aria-describedby="${id}-about"><span class="unit" title="${unitText(about.unit)}">${unitHtml(about.unit)}</span>
      <button type="button" class="reset" title="Back to the case’s value" aria-label="Reset ${label(key)}">↺</button>
      <p class="about" id="${id}-about">${escaped(about.meaning)}${boundsText(about)} <code>${key}</code></p>`);
    const [slider, field] = row.querySelectorAll("input");
    row.querySelector("label").htmlFor = id;
    const integer = about.kind === "integer";
    let range = null;
    slider.addEventListener("input", () => this.onValue(key, toValue(range, Number(slider.value), integer)));
    slider.addEventListener("keydown", (event) => {
      const coarse = {PageUp: 50, PageDown: -50, ArrowUp: 10, ArrowRight: 10, ArrowLeft: -10, ArrowDown: -10}[event.key];
      if (!coarse || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      const moved = integer ? valueOf(this.catalogue, this.experiment, key) + Math.sign(coarse) * (Math.abs(coarse) > 10 ? 10 : 1)
        : toValue(range, Math.min(Math.max(Number(slider.value) + coarse * (event.shiftKey ? 0.1 : 1), 0), SLIDER_STEPS));
      this.onValue(key, Math.min(Math.max(moved, range.low), range.high));
    });
    field.addEventListener("change", () => {
      const typed = typedNumber(field.value), wrong = outside(typed, about, integer);
      field.setAttribute("aria-invalid", String(Boolean(wrong)));
      row.classList.toggle("wrong", Boolean(wrong));
      row.querySelector(".about").firstChild.textContent = `${wrong ?? about.meaning + boundsText(about)} `;
      if (!wrong) this.onValue(key, typed);
    });
    row.querySelector(".reset").addEventListener("click", () => { this.onReset(key); slider.focus(); });
    this.rows.set(key, () => {
      const value = valueOf(this.catalogue, this.experiment, key);
      range = sliderRange(about, baseValue(this.catalogue, this.experiment, key));
      const shown = value ?? about.instead ?? null;
      slider.value = shown === null ? SLIDER_STEPS : toPosition(range, shown);
      slider.setAttribute("aria-valuetext", shown === null ? "none" : `${digits(shown)} ${unitText(about.unit)}`);
      if (!row.classList.contains("wrong")) field.value = value === null ? "" : plain(value);
      field.title = value === null ? "" : String(value);
      field.placeholder = about.instead == null ? "none" : plain(about.instead);
      row.classList.toggle("changed", key in this.experiment.values);
    });
    return row;
  }

  #choice(key, options) {
    const [row] = this.#row(key), id = `key-${key.replaceAll(".", "-")}`;
    if (options.every((option) => typeof option === "boolean")) {
      return this.#box(row, id, (on) => this.onSetting(key, on), () => [this.#chosen(key), key in this.experiment.settings], key);
    }
    return this.#select(row, id, options, (index) => this.onSetting(key, options[index]),
      () => [options.indexOf(this.#chosen(key)), key in this.experiment.settings], key);
  }

  #chosen(key) {
    return structureOf(this.catalogue, this.experiment).settings[key];
  }

  #switch(key, row, id) {
    return this.#box(row, id, (on) => this.onValue(key, Number(on)), () => [Boolean(valueOf(this.catalogue, this.experiment, key)), key in this.experiment.values], key);
  }

  // state(): [on, whether it is changed]
  #box(row, id, onChange, state, key) {
    row.classList.add("switch");
    row.insertAdjacentHTML("beforeend", `<input type="checkbox" id="${id}" role="switch">`);
    row.querySelector("label").htmlFor = id;
    const box = row.querySelector("input");
    box.addEventListener("change", () => onChange(box.checked));
    this.rows.set(key, () => {
      const [on, changed] = state();
      box.checked = on;
      row.classList.toggle("changed", changed);
    });
    return row;
  }

  #select(row, id, options, onChange, state, key) {
    row.classList.add("choice");
    row.insertAdjacentHTML("beforeend", `<select id="${id}">${options.map((option, index) => `<option value="${index}">${optionText(this.catalogue, key, option)}</option>`).join("")}</select>`);
    row.querySelector("label").htmlFor = id;
    const select = row.querySelector("select");
    select.addEventListener("change", () => onChange(Number(select.value)));
    this.rows.set(key, () => {
      const [index, changed] = state();
      select.value = String(index);
      row.classList.toggle("changed", changed);
    });
    return row;
  }

  // Show only rows that contain all words; sections with such rows open during a search.
  filter(text) {
    const words = text.toLowerCase().split(/\s+/).filter(Boolean);
    for (const section of this.holder.querySelectorAll("details")) {
      let any = false;
      for (const row of section.querySelectorAll(".row")) {
        row.hidden = !words.every((word) => row.dataset.words.includes(word));
        any ||= !row.hidden;
      }
      section.hidden = !any;
      section.open = words.length ? any : OPEN.has(section.dataset.heading) || section.querySelector(".changed") !== null;
    }
  }
}

// Label of an option for users.
export function optionText(catalogue, key, option) {
  const {choices: known, labels} = catalogue.keys[key] ?? {};
  return labels?.[known.indexOf(option)] ?? String(option).replaceAll("-", " ");
}

function counted(changed) {
  return changed ? `${changed} changed` : "";
}

function typedNumber(text) {
  const word = text.trim().replaceAll("−", "-").replace(",", ".");
  return word === "" || word === "none" ? null : Number(word);
}

function outside(value, about, integer) {
  const {low, high} = about;
  if (value === null) return about.optional ? null : "Must be a number.";
  if (Number.isNaN(value) || (integer && !Number.isInteger(value))) return integer ? "Must be a whole number." : "Must be a number.";
  return (low != null && value < low) || (high != null && value > high) ? `Out of range${boundsText(about)}` : null;
}

function boundsText({low, high}) {
  if (low == null && high == null) return ".";
  if (high == null) return `; at least ${digits(low)}.`;
  return low == null ? `; at most ${digits(high)}.` : `; ${digits(low)} to ${digits(high)}.`;
}

function escaped(text) {
  return String(text).replaceAll("&", "&amp;").replaceAll('"', "&quot;").replaceAll("<", "&lt;");
}
