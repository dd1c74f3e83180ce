"""Questions to an app from another thread: each is an event that its own thread answers."""

from collections.abc import Callable
from typing import Any

from controller_apps.openflow.framework import Event, hub
from controller_apps.timeouts import ANSWER_TIMEOUT_S

Handler = Callable[[dict[str, Any]], Any]


class Refused(Exception):
    """A question that is refused; the message names value and remedy."""


class EventQuestion(Event):
    """A question by name; its answer is anything JSON can hold, and may come later."""

    def __init__(self, name: str, fields: dict[str, Any]) -> None:
        super().__init__()
        self.name = name
        self.fields = fields
        self._answers: Any = hub.Queue()

    def answer(self, answer: Any) -> None:
        self._answers.put(answer)

    def wait(self) -> Any:
        """Return the answer; raise Refused if there is none or it does not come in time."""
        try:
            answer = self._answers.get(timeout=ANSWER_TIMEOUT_S)
        except hub.QueueEmpty as error:
            text = f"the controller did not answer {self.name!r} in {ANSWER_TIMEOUT_S:g} s"
            raise Refused(text) from error
        if isinstance(answer, Refused):
            raise answer
        return answer


def ask(app: Any, name: str, **fields: Any) -> Any:
    """Ask an app from another thread, and wait for its answer; raise Refused without one."""
    question = EventQuestion(name, fields)
    app.send_event(app.name, question)
    return question.wait()


def reply(question: EventQuestion, handlers: dict[str, Callable[..., Any]]) -> None:
    try:
        if question.name not in handlers:
            raise Refused(f"this app does not answer {question.name!r}")
        question.answer(handlers[question.name](**question.fields))
    except Refused as refused:
        question.answer(refused)
