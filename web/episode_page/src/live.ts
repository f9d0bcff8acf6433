/** Follows a running episode: what the server sends becomes the page's, and the page says how things stand. */

import { byId, say } from "./dom";
import { readEpisode, type Episode } from "./episode";
import type { EpisodePage } from "./page";

class Live {
  private readonly state = byId("state");
  private readonly button = byId<HTMLButtonElement>("live");
  private page: EpisodePage | undefined;
  /** Whether another episode has begun. */
  private replaced = false;

  constructor(private readonly show: (episode: Episode) => EpisodePage) {
    this.state.hidden = false;
    this.button.addEventListener("click", () => (this.replaced ? this.anew() : this.page?.follow()));
  }

  take(kind: string, episode: Episode): void {
    if (kind === "more") this.page?.append(episode);
    else if (this.page) return this.anew(); // the connection was lost for a while
    else {
      this.page = this.show(episode);
      document.title = episode.head.title;
      say(byId("title"), episode.head.title);
      this.watch();
    }
    this.tell(this.page?.live ? "live" : "ended");
  }

  tell(text: string): void {
    say(this.state, text);
  }

  /** Another episode has begun: who stayed with the end goes on to it. */
  replace(): void {
    this.replaced = true;
    if (!this.page || this.page.following || this.page.atEnd) this.anew();
    this.tell("ended");
  }

  /** Shows from the begin what the server has now, with the same camera. */
  private anew(): void {
    this.page?.play(false); // a page that plays would still write its moment into the address, and so stay
    if (this.page) history.replaceState(null, "", `#c=${this.page.moment.camera}`);
    location.reload();
  }

  private watch(): void {
    const { page, replaced } = this;
    say(this.button, replaced ? "Next episode" : "Go to the present");
    this.button.hidden = !replaced && (!page?.live || page.following);
    requestAnimationFrame(() => this.watch());
  }
}

/** Listens to the stream of a server; ends with an error where its data cannot be shown. */
export function listen(address: string, show: (episode: Episode) => EpisodePage): Promise<never> {
  const [source, live] = [new EventSource(address), new Live(show)];
  say(byId("wait"), "Waiting for an episode …");
  return new Promise((_, fail) => {
    let before = Promise.resolve();
    const after = (action: () => Promise<void> | void) => (before = before.then(action).catch(fail));
    for (const kind of ["begin", "more"]) {
      source.addEventListener(kind, ({ data }: MessageEvent<string>) =>
        after(async () => live.take(kind, await readEpisode(data))));
    }
    source.addEventListener("next", () => {
      source.close();
      void after(() => live.replace());
    });
    source.addEventListener("error", () => after(() => live.tell("not connected")));
  });
}
