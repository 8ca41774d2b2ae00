"""Which version of Argosy this is; a daemon that read it from the installed package would need 3 MB more."""

RELEASE = "0.2.0"
