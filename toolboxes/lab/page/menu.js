// The menu for sharing and opening; files may also be dropped anywhere.

// actions: name → function of its button; onFile(file).
export function connectMenu(actions, onFile) {
  const menu = document.getElementById("menu"), input = document.getElementById("file");
  menu.addEventListener("click", async (event) => {
    const action = actions[event.target.dataset.do];
    if (!action) return;
    await action();
    menu.open = false;
  });
  document.addEventListener("click", (event) => { if (!menu.contains(event.target)) menu.open = false; });
  menu.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    menu.open = false;
    menu.querySelector("summary").focus();
  });
  input.addEventListener("change", () => {
    const [file] = input.files;
    menu.open = false;
    if (file) onFile(file);
    input.value = "";
  });
  input.parentElement.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    input.click();
  });
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    if (event.dataTransfer.files[0]) onFile(event.dataTransfer.files[0]);
  });
}
