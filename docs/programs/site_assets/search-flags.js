// Mends what the theme's search does with words; it stands before the theme's own script, which makes the worker that searches.
// A word that begins with "-" is one to leave out there, so that a flag typed as it is written would find nothing. And a page that
// is found by its sections alone is said to hold none of the words, so that nothing would be highlighted on it.
"use strict";
{
  const QUERY = 2, RESULT = 3; // of the theme's messages to the worker, and back
  const mend = ({ data: message }) => {
    for (const page of message?.type === RESULT ? message.data.items : [])
      for (const found of page)
        if (!Object.keys(found.terms).length)
          for (const section of page)
            for (const [word, there] of Object.entries(section.terms)) if (there) found.terms[word] = true;
  };
  window.Worker = class extends window.Worker {
    constructor(...options) {
      super(...options);
      this.addEventListener("message", mend);
    }
    postMessage(message, ...more) {
      const asked = message?.type === QUERY && typeof message.data === "string";
      super.postMessage(asked ? { ...message, data: message.data.replace(/(^|\s)-+|-+(?=\s|$)/g, "$1") } : message, ...more);
    }
  };
}
