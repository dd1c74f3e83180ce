// On the page of a command of which no network runs: to the next one, as soon as there is one.

const status = document.querySelector("[role=status]");
try {
  const { over } = await (await fetch(new URL("networks?next", import.meta.url))).json();
  if (over) status.textContent = status.textContent.replace(/This page .*/, "So has its command.");
  else location.reload();
} catch {
  status.textContent = "The command does not answer any more.";
}
