"""For tests of trees and of the engine: planned leaves, recorded cases, random trees."""
