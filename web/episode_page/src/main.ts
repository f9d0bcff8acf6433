/** Starts the page: reads the data that stands in it, or says why it cannot be shown. */

import { byId, say } from "./dom";
import { readEpisode, type Episode } from "./episode";
import { listen } from "./live";
import { EpisodePage } from "./page";

declare global {
  interface Window {
    episodePage?: EpisodePage;
  }
}

/** Shows an episode, which `live` says is under way. */
function show(episode: Episode, live: boolean): EpisodePage {
  const page = new EpisodePage(episode, live);
  byId("wait").hidden = true;
  return (window.episodePage = page);
}

async function start(): Promise<void> {
  const { textContent, dataset } = byId("episode");
  try {
    if (dataset.stream) await listen(dataset.stream, (episode) => show(episode, true));
    else show(await readEpisode(textContent ?? ""), false);
  } catch (error) {
    say(byId("wait"), `This page cannot be shown: ${error instanceof Error ? error.message : String(error)}`);
    byId("wait").hidden = false;
    throw error;
  }
}

void start();
