"""Code and files of users: plug-ins that add internal actions, and which files a program may read or write."""
