/** The part of the address after `#`: time, actor, camera and whether episodes are side by side, so that people can send each other a moment. */

import { CAMERAS, type CameraName } from "./cameras";

export interface Moment {
  time?: number;
  actor?: number;
  camera?: CameraName;
  /** Whether the episodes are beside each other. */
  beside?: boolean;
}

/** Reads `#t=12.5&v=3&c=above`; what is missing or no value is left out. */
export function readMoment(hash: string): Moment {
  const parts = new URLSearchParams(hash.replace(/^#/, ""));
  const number = (name: string) => (parts.has(name) ? Number(parts.get(name) || NaN) : NaN);
  const [time, actor] = [number("t"), number("v")];
  const camera = CAMERAS.find((name) => name === parts.get("c"));
  return {
    ...(Number.isFinite(time) ? { time } : {}),
    ...(Number.isInteger(actor) ? { actor } : {}),
    ...(camera ? { camera } : {}),
    ...(parts.has("b") ? { beside: parts.get("b") === "1" } : {}),
  };
}

export class Link {
  private own = "";

  /** `go` shows the moment of an address that another wrote. */
  constructor(
    private readonly moment: () => Required<Moment>,
    private readonly go: (moment: Moment) => void,
  ) {
    addEventListener("hashchange", () => location.hash !== this.own && this.apply());
  }

  apply(): void {
    this.go(readMoment(location.hash));
  }

  /** Puts the moment into the address, without an entry in the history. */
  remember(): void {
    const { time, actor, camera, beside } = this.moment();
    this.own = `#t=${time.toFixed(2)}&v=${actor}&c=${camera}${beside ? "&b=1" : ""}`;
    location.replace(this.own);
  }

  /** The page's address at the present moment. */
  get address(): string {
    this.remember();
    return location.href;
  }
}
