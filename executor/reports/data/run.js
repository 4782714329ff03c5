// Buttons of steps lead to their moment in the video.
document.querySelectorAll("button.seek").forEach(function (button) {
  button.addEventListener("click", function (event) {
    event.preventDefault();
    const video = document.querySelector("video");
    if (!video) return;
    video.currentTime = parseFloat(button.dataset.at);
    video.play();
    video.scrollIntoView({ behavior: "smooth", block: "center" });
  });
});
