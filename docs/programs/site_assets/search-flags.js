// The search takes a word that begins with "-" for one to leave out, so that a flag typed as it is written finds nothing.
"use strict";
{
  const QUERY = 2; // of the theme's messages to the worker that searches
  const send = Worker.prototype.postMessage;
  Worker.prototype.postMessage = function (message, ...more) {
    const asked = message?.type === QUERY && typeof message.data === "string";
    return send.call(this, asked ? { ...message, data: message.data.replace(/(^|\s)-+|-+(?=\s|$)/g, "$1") } : message, ...more);
  };
}
