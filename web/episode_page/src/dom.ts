/** Elements from code. Texts are always text, never markup: names in a bag may be anything. */

type Attributes = Record<string, string | number | boolean | ((event: Event) => void)>;

export function element<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: (Node | string)[]
): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") made.addEventListener(name, value);
    else if (typeof value === "boolean") made.toggleAttribute(name, value);
    else made.setAttribute(name, String(value));
  }
  made.append(...children);
  return made;
}

/** The element of the page with an id. */
export function byId<T extends HTMLElement = HTMLElement>(id: string): T {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no element ${id}`);
  return found as T;
}

const said = new WeakMap<HTMLElement, string>();

/** Sets the text of an element that nobody else writes to, where it changes, so that nothing is laid out for nothing. */
export function say(target: HTMLElement, text: string): void {
  if (said.get(target) === text) return;
  said.set(target, text);
  target.textContent = text;
}

/** `predicate.lane_changes` as `predicate: lane changes`. */
export function words(code: string): string {
  return code.toLowerCase().replaceAll("_", " ").replace(".", ": ");
}
