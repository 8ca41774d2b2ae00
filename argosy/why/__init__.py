"""Why an agent did, or did not do, something: `explain` asks a running fleet, `tell` explains a view of a mind."""

from argosy.why.explaining import explain, tell
from argosy.why.mails import MailFacts
from argosy.why.story import Explanation, Line, Paragraph, plain

__all__ = ["Explanation", "Line", "MailFacts", "Paragraph", "explain", "plain", "tell"]
