/* Another rescuer, for the tests: its bid is what it is told. */

