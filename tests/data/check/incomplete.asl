// What hides other findings: files that cannot be read.
{ include("not_there.asl") }                       // file
{ include("no_program.asl") }                      // syntax, there
+!late(File) <- .include(File).                    // known-when-run
