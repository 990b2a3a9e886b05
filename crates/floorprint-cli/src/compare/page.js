// One map is shown at a time: the chosen one, or each in turn.
{
  const maps = [...document.querySelectorAll(".blink")], choices = [...document.querySelectorAll("input[name=map]")];
  const choose = (number) => {
    choices[number].checked = true;
    maps.forEach((map, other) => map.classList.toggle("hidden", other !== number));
  };
  choices.forEach((choice, number) => choice.addEventListener("change", () => choose(number)));
  let timer = null;
  document.getElementById("blink").addEventListener("change", (event) => {
    clearInterval(timer);
    const next = () => choose((choices.findIndex((choice) => choice.checked) + 1) % choices.length);
    if (event.target.checked) timer = setInterval(next, 700);
  });
}
