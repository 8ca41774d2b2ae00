"""Why an agent did, or did not do, something: `explain` asks a running fleet, `tell` a view of a mind."""

from argosy.why.answer import Explanation, Line, Paragraph, plain
from argosy.why.explain import explain, tell
from argosy.why.unanswered_questions import MailFacts

__all__ = ["Explanation", "Line", "MailFacts", "Paragraph", "explain", "plain", "tell"]
