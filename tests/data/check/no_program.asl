// Included by incomplete.asl: no program.
+!start <- .print("a") .print("b").                // syntax
