// Copyright 2026 velocity_estimator contributors
// SPDX-License-Identifier: Apache-2.0

// The theme searches in a Worker, which browsers do not start from file://. There it runs in a frame.
// The name of this file keeps the plugin `offline` from loading its own version from the network.
if (location.protocol === 'file:') {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement('iframe');
      frame.hidden = true;
      document.documentElement.append(frame);
      const inside = frame.contentWindow, page = frame.contentDocument;
      page.open();
      page.write('<!doctype html><body></body>');
      page.close();
      inside.postMessage = data => this.dispatchEvent(new MessageEvent('message', {data}));
      this.inside = inside;
      this.ready = new Promise(loaded => {
        const script = page.createElement('script');
        script.src = url;
        script.onload = loaded;
        page.body.append(script);
      });
    }

    postMessage(data) {
      this.ready.then(() => this.inside.dispatchEvent(new MessageEvent('message', {data})));
    }
  };
}
