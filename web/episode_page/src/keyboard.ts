/** Keys of the page; those that a control needs for itself stay with it. */

/** What each key does, by the name that its event has; `shift` says whether that key is down too. */
export type Keys = Record<string, (shift: boolean) => void>;

export function listenToKeys(keys: Keys): void {
  addEventListener("keydown", (event) => {
    const { tagName, id } = event.target as HTMLElement;
    if (event.ctrlKey || event.altKey || event.metaKey || tagName === "SELECT") return;
    if (tagName === "BUTTON" && event.key === " ") return;
    if (id === "scrub" && event.key.startsWith("Arrow")) return;
    const action = keys[event.key];
    if (!action) return;
    event.preventDefault();
    action(event.shiftKey);
  });
}
