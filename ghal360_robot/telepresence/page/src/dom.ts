/** Elements of index.html, by their id and kind. */
export function element<T extends Element>(id: string, kind: abstract new () => T): T {
  const found = document.getElementById(id);
  if (!(found instanceof kind)) throw new Error(`index.html has no ${kind.name} called ${id}`);
  return found;
}

/** Change a text only where it differs: twenty states a second would keep the browser laying out. */
export function write(target: Element, text: string): void {
  if (target.textContent !== text) target.textContent = text;
}
