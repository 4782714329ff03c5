// The page of a run has its episode in it.
document.querySelectorAll(".episode").forEach(openEpisode);
