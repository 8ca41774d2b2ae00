!walk.

+!walk
  <- compass.settle(0.1);
     B = compass.bearing(52, 13, 52.1, 13.1);
     compass.near(B, Point, Off);
     .print("going ", Point, ", ", math.round(Off), " degrees off");
     .findall(P, compass.point(P, D) & D < 180, Points);
     .print(Points).
