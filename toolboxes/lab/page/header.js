// Choice of case, law, estimator and coordination, in the page's header.

import {optionText} from "./controls.js";
import {choices, structureOf} from "./experiment.js";

const NAMES = {"controller.kind": "Law", "controller.estimator": "Estimator", "controller.coordination.kind": "Coordination"};

export const IN_HEADER = Object.keys(NAMES);

// onCase(id), onSetting(key, choice); returns a function that shows an experiment.
export function connectHeader(holder, catalogue, {onCase, onSetting}) {
  holder.append(caseChoice(catalogue, onCase));
  for (const [key, name] of Object.entries(NAMES)) {
    const options = choices(catalogue).get(key);
    if (!options) continue;
    const label = document.createElement("label");
    label.innerHTML = `<span>${name}</span><select data-key="${key}">${options.map((option) => `<option value="${option}">${optionText(catalogue, key, option)}</option>`).join("")}</select>`;
    label.querySelector("select").addEventListener("change", (event) => onSetting(key, event.target.value));
    holder.append(label);
  }
  return (experiment) => {
    holder.querySelectorAll("input[name=case]").forEach((input) => { input.checked = input.value === experiment.case; });
    const {settings} = structureOf(catalogue, experiment);
    holder.querySelectorAll("select").forEach((select) => { select.value = String(settings[select.dataset.key]); });
  };
}

function caseChoice(catalogue, onCase) {
  const cases = document.createElement("div");
  cases.className = "cases";
  cases.setAttribute("role", "radiogroup");
  cases.setAttribute("aria-label", "Case of the paper");
  cases.innerHTML = `<span>Case</span>${catalogue.cases.map(({id, label}) => `<label title="${label}"><input type="radio" name="case" value="${id}" aria-label="${label}">${id.replace("case-", "")}</label>`).join("")}`;
  cases.addEventListener("change", (event) => onCase(event.target.value));
  return cases;
}
