#pragma once

#include <cstdint>
#include <string>
#include <vector>

/// The checks of reliability, each in a short form for every day and a long one for the slow suite.
/// Each runs in a world of its own (hosts.hpp), prints what it measured, and fails the test by
/// EXPECT. The caller has asked why_no_hosts().
namespace weft::test_hosts {

/// A set on the hosts alpha, beta and gamma; the camera is alone on alpha and gives `frames`
/// frames. Of a thousand packets, per_thousand are lost on the way to beta and to gamma, but for
/// the first and the last frames. local_text: the same set without its camera, for one host.
void three_hosts(const std::string& set_text, const std::string& local_text, int frames,
                 int per_thousand);

/// kill -9 of each process in turn, `rounds` times over, under frames from the set's own source.
/// set_text: of one host. back_within_s: how soon a killed process must have answered a frame.
void kill_in_turn(const std::string& set_text, int rounds, double back_within_s);

/// One stage is stopped for stop_s, then goes on.
void stop_and_go(double stop_s);

/// `messages` of garbage (random, truncated, colliding with a fingerprint, oversized) on every
/// channel that there is. set_text: with a source, eye, that waits for a trigger. good_frame: an
/// RGBD_FRAME that the stages answer.
void garbage(const std::string& set_text, const std::vector<std::uint8_t>& good_frame,
             int messages);

/// `frames` frames, as fast as they are answered: these RGBD_FRAME messages again and again.
void soak(const std::string& set_text, const std::vector<std::vector<std::uint8_t>>& messages,
          int frames);

/// Camera and stages of test_stage.hpp as the text of a set. source: more keys of the source; none:
/// no source.
std::string small_set(const std::string& source);
/// The same for three_hosts().
std::string small_set_on_three_hosts(int frames, int bytes, double rate_hz);

}  // namespace weft::test_hosts
