// empty-program
