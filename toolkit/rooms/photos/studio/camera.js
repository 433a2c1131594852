// The live camera, where the browser gives it to a page: over https, and on the machine that serves the page.

export const mayAsk = () => window.isSecureContext && !!navigator.mediaDevices?.getUserMedia;

export class Camera {
  constructor(video) {
    this.video = video;
    this.stream = null;
  }

  get on() {
    return this.stream !== null;
  }

  async start() {
    this.stream = await navigator.mediaDevices.getUserMedia({
      audio: false, video: { facingMode: { ideal: "environment" }, width: { ideal: 3840 }, height: { ideal: 2880 } },
    });
    this.video.srcObject = this.stream;
    await this.video.play();
  }

  stop() {
    for (const track of this.stream?.getTracks() ?? []) track.stop();
    this.stream = null;
    this.video.srcObject = null;
  }

  get zoom() {
    return this.stream?.getVideoTracks()[0]?.getCapabilities?.().zoom ?? null;
  }

  setZoom(value) {
    return this.stream?.getVideoTracks()[0]?.applyConstraints({ advanced: [{ zoom: value }] });
  }

  // A still of the sensor's own size where the browser can take one, else the frame that is shown.
  async take() {
    const track = this.stream.getVideoTracks()[0];
    if ("ImageCapture" in window) {
      try {
        return await new ImageCapture(track).takePhoto();
      } catch {
        // some cameras have no stills: the frame will do
      }
    }
    const canvas = document.createElement("canvas");
    canvas.width = this.video.videoWidth;
    canvas.height = this.video.videoHeight;
    canvas.getContext("2d").drawImage(this.video, 0, 0);
    return new Promise((resolve) => canvas.toBlob(resolve, "image/jpeg", 0.95));
  }
}
