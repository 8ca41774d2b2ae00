/* Stands in for the files of Jason's own test harness, which test programs include by $jasonJar/...:
   `agentd test` runs the test plans itself, and assertions.asl has the assertions. */
