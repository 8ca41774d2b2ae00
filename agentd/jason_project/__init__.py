"""Jason's project files (.mas2j): the parser with its tree, and the loader that turns a project into agents."""
