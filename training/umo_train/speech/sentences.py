"""Sentences of our own: a small grammar over word lists chosen for their phones, and invented words."""

import random

_PEOPLE = (
    "my mother, the teacher, Peter, her brother, our neighbour, the old man, a young woman, Bob, Martha, the captain, "
    "the baker, Vivian, the farmer, his wife, a visitor, the painter, Paul, Emma, the woman upstairs, my best friend, "
    "the judge, a famous pilot, the boy, the girl, Thomas, everybody, nobody, the whole family, your boss, Philip"
).split(", ")
_THINGS = (
    "the map, a bag of apples, the blue boat, some paper, an empty box, the piano, a bottle of milk, the big bridge, "
    "a warm coat, the kitchen table, a pot of soup, the front door, a heavy book, the lamp, fresh bread, the garden, "
    "a bowl of plums, the computer, a picture of the moon, five maps, the number seven, a piece of cheese, the video, "
    "a broken umbrella, the violin, the whole problem, a simple answer, the first page, their old house, the beach, "
    "a purple hat, the movie, a cup of coffee, the window, the shop, a wooden toy, the volume, many thousand photos, "
    "the weather report, a good measure of sugar, the television, a small fish, the engine, the path to the village"
).split(", ")
_VERBS = (
    "found, bought, forgot, moved, opened, described, believed in, looked at, pushed, painted, took, gave away, "
    "brought back, talked about, wanted, dropped, carried, remembered, showed me, put down, paid for, saw, wrote "
    "about, fixed, loved, imagined, jumped over, thought about, laughed at, measured, judged, chose, voted for, "
    "worried about"
).split(", ")
_PLACES = (
    "in the morning, by the river, at the market, on top of the hill, after the meeting, before breakfast, in "
    "May, under the bridge, all over the world, behind the church, near the airport, on a rainy afternoon, with "
    "both hands, for the very first time, without a word, in about five minutes, over there, at the same moment, "
    "from the beginning, on the other side of the road, just outside the village, during the storm, in the middle "
    "of the night, every day"
).split(", ")
_OPENERS = (
    "well, so, you know, honestly, of course, listen, maybe, by the way, look, in fact, to be fair, first of all, "
    "on the other hand, for example, believe me, as far as I know, between you and me, obviously, sometimes, in my view"
).split(", ")
_CLAUSES = (
    "I really don't think so, that is not what I meant, it was bigger than I remembered, we should leave before "
    "five, everything happens for a reason, it could be much better, people always say that, there is nothing to "
    "be afraid of, I promise you will love it, the price went up again, you have to push it very hard, they never "
    "told us about it, it's about this wide and that tall, the point is simple, we have three options, nothing is "
    "free, it made me happy, I have no idea, this is the best part, the rest was easy, we both know how it ends, "
    "it depends on the weather, you can move it up or down, the problem is bigger than that, I was absolutely "
    "amazed, somebody has to do it"
).split(", ")
_QUESTIONS = (
    "why would anybody do that, how many people came, what do you mean by that, could you open it for me, "
    "do you want to see the whole picture, who took my umbrella, where should we put it, is that even possible, "
    "have you ever been to Paris, when will the movie begin, how big is it, which one do you prefer, shall we begin"
).split(", ")
_ADJECTIVES = (
    "beautiful, enormous, impossible, very quiet, expensive, brave, simple, strange, brown, available, perfectly "
    "normal, absurd, famous, half empty, smooth, quite thin, yellow, rather bumpy, fabulous, weird, warm, "
    "obvious, thoughtful"
).split(", ")
_COUNTING = (
    "one, two, three, four, five",
    "first the bread, second the butter, third the plums",
    "there are two sides to it, a good one and a bad one",
    "six, seven, eight, nine, ten",
    "point one is the price, point two is the time",
)
_ONSETS = (
    "b bl br ch d dr f fl fr g gl gr h j k kl kr l m n p pl pr qu r s sh sk sl sm sn sp spr st str t th tr v w y z"
)
_NUCLEI = "a e i o u ee oo ai oa ow oy ar er or ea ie aw"
_CODAS = "b d f g k l m n p r s t v x z sh ch th nd nt mp st sk ft lt lp lm ng nk rd rm rp b m p"


def sentence(random_: random.Random) -> str:
    """One sentence, with its full stop or question mark."""
    pick = random_.choice
    forms = (
        lambda: f"{pick(_PEOPLE)} {pick(_VERBS)} {pick(_THINGS)} {pick(_PLACES)}.",
        lambda: f"{pick(_OPENERS)}, {pick(_PEOPLE)} {pick(_VERBS)} {pick(_THINGS)}.",
        lambda: f"{pick(_OPENERS)}, {pick(_CLAUSES)}.",
        lambda: f"{pick(_CLAUSES)}, and {pick(_PEOPLE)} {pick(_VERBS)} {pick(_THINGS)}.",
        lambda: f"{pick(_PEOPLE)} {pick(_VERBS)} {pick(_THINGS)}, but {pick(_CLAUSES)}.",
        lambda: f"{pick(_OPENERS)}, {pick(_QUESTIONS)}?",
        lambda: f"{pick(_QUESTIONS)}?",
        lambda: f"{pick(_THINGS)} was {pick(_ADJECTIVES)} and {pick(_ADJECTIVES)}.",
        lambda: f"{pick(_PLACES)}, {pick(_PEOPLE)} {pick(_VERBS)} {pick(_THINGS)}, because {pick(_CLAUSES)}.",
        lambda: f"{pick(_COUNTING)}.",
        lambda: f"{pick(_PEOPLE)} {pick(_VERBS)} a {_invented(random_)} and {_invented(random_)} {pick(_PLACES)}.",
        lambda: f"{_invented(random_)}, {_invented(random_)}, {_invented(random_)} and {_invented(random_)}.",
    )
    weights = (4, 4, 3, 3, 3, 2, 1, 2, 3, 0.5, 3, 2)
    text = random_.choices(forms, weights)[0]()
    return text[0].upper() + text[1:]


def _invented(random_: random.Random) -> str:
    """A word of one or two syllables that is in no list: phone contexts that are rare in real sentences."""
    onsets, nuclei, codas = _ONSETS.split(), _NUCLEI.split(), _CODAS.split()
    pick = random_.choice
    word = pick(onsets) + pick(nuclei) + pick(codas)
    return word + pick(nuclei) + pick(codas) if random_.random() < 0.3 else word
