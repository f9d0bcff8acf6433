/** The panel's section about why the selected actor drives as it does, or why that is not known. */

import { byId, element, say } from "./dom";
import type { Episode } from "./episode";
import { Why, type Reasons } from "./why";

const KMH = 3.6;
const NO_DECISION = "SIREN does not decide for it now; it decides for EMVs and for civilians who make way.";

export class WhySection {
  private readonly why: Why | undefined;
  private shown = "";

  constructor(
    private readonly episode: Episode,
    private readonly select: (id: number) => void,
    private readonly nameOf: (id: number) => string,
  ) {
    this.why = episode.head.why && new Why(episode);
  }

  /** Shows the reasons of an actor at a time; `none` says what there is in place of a target speed. */
  show(actor: number, time: number, none: string): void {
    const reasons = this.why?.of(actor, Math.round(time / this.episode.head.step_s));
    const key = JSON.stringify([reasons, none]);
    if (key === this.shown) return;
    this.shown = key;
    byId("why-known").hidden = !reasons;
    byId("why-not").hidden = !!reasons;
    say(byId("why-not"), this.why ? NO_DECISION : this.episode.head.no_why);
    if (reasons) this.tell(reasons, none);
  }

  private tell({ target, limits, guards }: Reasons, none: string): void {
    say(byId("why-target"), target < 0 ? none : `${(target * KMH).toFixed(1)} km/h`);
    byId("why-table").hidden = limits.length === 0;
    byId("why-limits").replaceChildren(
      ...limits.map(({ mechanism, speed, blocker }, place) => {
        const press = () => this.select(blocker);
        const link = blocker ? element("button", { type: "button", click: press }, this.nameOf(blocker)) : "";
        return element(
          "tr",
          place === 0 ? { class: "lowest" } : {},
          element("th", { scope: "row" }, mechanism),
          element("td", {}, `${(speed * KMH).toFixed(1)} km/h`),
          element("td", {}, link),
        );
      }),
    );
    byId("why-guards").replaceChildren(
      ...guards.map(({ name, acts, why }) =>
        element("li", acts ? { class: "acts" } : {}, `${acts ? "✓" : "–"} ${name}`, element("span", {}, why))),
    );
    byId("why-guards-head").hidden = guards.length === 0;
  }
}
