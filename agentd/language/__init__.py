"""The Jason dialect of AgentSpeak: grammar and parser, its abstract syntax, run-time terms, and the compiler."""
