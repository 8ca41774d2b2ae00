"""`argosy ui`: a web page that shows a running fleet and what its agents think, on the operator's own machine."""
