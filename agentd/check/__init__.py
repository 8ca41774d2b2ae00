"""`agentd check`: find mistakes in programs without running them.

`command` is the command line, `programs` finds and reads the programs, `survey` and `symbol_table` collect what each
program mentions, `external_knowledge` says what reaches an agent from its robot, team and operator. Each `rules_*`
module makes findings of one kind; `finding_kinds` lists them all with severity and code.
"""
