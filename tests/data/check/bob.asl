// Of team.mas2j: its goal begin stands in the project.
+!begin <- .send(ann, achieve, fetch(ball)).
