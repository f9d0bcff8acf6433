/** Starts the page: reads the data that stands in it, or says why it cannot be shown. */

import { byId, say } from "./dom";
import { readEpisode } from "./episode";
import { EpisodePage } from "./page";

declare global {
  interface Window {
    episodePage?: EpisodePage;
  }
}

async function start(): Promise<void> {
  try {
    window.episodePage = new EpisodePage(await readEpisode(byId("episode").textContent ?? ""));
    byId("wait").hidden = true;
  } catch (error) {
    say(byId("wait"), `This page cannot be shown: ${error instanceof Error ? error.message : String(error)}`);
    throw error;
  }
}

void start();
