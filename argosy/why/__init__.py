"""Why an agent did, or did not do, something: `explain` asks a running fleet, `explain_view` a view of a mind."""

from argosy.why.answer import Explanation, Line, Paragraph, plain
from argosy.why.explain import explain, explain_view
from argosy.why.unanswered_questions import MailFacts

__all__ = ["Explanation", "Line", "MailFacts", "Paragraph", "explain", "explain_view", "plain"]
