"""`argosy replay`: publish a recording again, print its contents, or run a recorded mind again."""
