// Theme: light, dark or the system's; colours come from the style sheet.

const ORDER = ["auto", "light", "dark"];
const NAMES = {auto: "Theme: as the system", light: "Theme: light", dark: "Theme: dark"};
const SIGNS = {auto: "◐", light: "○", dark: "●"};

export function connectTheme(button, redraw) {
  const stored = () => { try { return localStorage.getItem("dualwinch-lab-theme"); } catch { return null; } };
  const show = (theme) => {
    if (theme === "auto") document.documentElement.removeAttribute("data-theme");
    else document.documentElement.dataset.theme = theme;
    button.textContent = SIGNS[theme];
    button.title = NAMES[theme];
    button.setAttribute("aria-label", `${NAMES[theme]}. Change`);
    button.value = theme;
    redraw();
  };
  button.addEventListener("click", () => {
    const theme = ORDER[(ORDER.indexOf(button.value) + 1) % ORDER.length];
    try { localStorage.setItem("dualwinch-lab-theme", theme); } catch { /* a page opened from a file may not store */ }
    show(theme);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  show(ORDER.includes(stored()) ? stored() : "auto");
}

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}
