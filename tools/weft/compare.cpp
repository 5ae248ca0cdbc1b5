#include "tools/weft/compare.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>

#include "base/error.hpp"
#include "stage/telemetry.hpp"
#include "tools/weft/frame_content.hpp"
#include "tools/weft/log_index.hpp"
#include "tools/weft/message.hpp"
#include "tools/weft/page.hpp"
#include "weft/camera_pose_t.hpp"
#include "weft/grasps_t.hpp"
#include "weft/part_detections_t.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/stage_timing_t.hpp"

namespace weft {
namespace {

using nlohmann::ordered_json;

/// "detections[3].centre_sensor[0]" without its indices.
std::string without_indices(const std::string& path) {
  std::string out;
  bool inside = false;
  for (const char c : path) {
    if (c == '[') inside = true;
    if (!inside) out += c;
    if (c == ']') inside = false;
  }
  return out;
}

/// The timings of a run. suffix: of the stages that count; empty: those without any '@' if
/// variants_out, else all.
TimingReport read_timing(const std::string& file, const std::string& suffix,
                         const std::set<std::string>& left_out) {
  TimingCollector timing;
  stage::LogReader log(file);
  for (stage::LogEvent event; log.next(event);) {
    const auto wanted = [&](std::string& stage) {
      if (suffix.empty()) return !left_out.contains(stage);
      if (!stage.ends_with(suffix)) return false;
      stage.resize(stage.size() - suffix.size());
      return true;
    };
    if (event.channel == stage::kTimingChannel) {
      auto message = decode_message<weft::stage_timing_t>(event.data);
      if (message && wanted(message->stage)) timing.add(*message);
    } else if (event.channel == stage::kStatusChannel) {
      auto message = decode_message<weft::stage_status_t>(event.data);
      if (message && wanted(message->stage)) timing.add(*message);
    }
  }
  return timing.report();
}

/// End to end and throughput of a variant and of what it replaces, in one log: each from a frame's
/// first input anywhere to the last answer of these stages, since both wait for the same others.
void measure_to(TimingReport& report, const std::string& file, const std::set<std::string>& last) {
  struct Times {
    std::int64_t began = std::numeric_limits<std::int64_t>::max(), ended = 0;
  };
  std::map<FrameName, Times> frames;
  std::set<std::pair<FrameName, std::string>> seen;  // of repeats, the first counts
  stage::LogReader log(file);
  for (stage::LogEvent event; log.next(event);) {
    if (event.channel != stage::kTimingChannel) continue;
    const auto timing = decode_message<weft::stage_timing_t>(event.data);
    if (!timing) continue;
    const FrameName name{timing->header.camera, timing->header.session, timing->header.seq};
    if (!seen.insert({name, timing->stage}).second) continue;
    auto& times = frames[name];
    times.began = std::min(times.began, timing->received_utime);
    if (last.contains(timing->stage)) times.ended = std::max(times.ended, timing->published_utime);
  }
  std::vector<double> took_ms;
  Times all;
  for (const auto& [name, times] : frames) {
    if (times.ended == 0) continue;
    took_ms.push_back((static_cast<double>(times.ended) - static_cast<double>(times.began)) * 1e-3);
    all.began = std::min(all.began, times.began);
    all.ended = std::max(all.ended, times.ended);
  }
  report.end_to_end = quantiles(took_ms);
  const double time_us = static_cast<double>(all.ended) - static_cast<double>(all.began);
  report.frames_per_second = time_us > 0 ? static_cast<double>(took_ms.size()) * 1e6 / time_us : 0;
}

std::vector<Detection> detections_of(const std::vector<std::uint8_t>& data, double threshold) {
  std::vector<Detection> out;
  const auto message = decode_message<weft::part_detections_t>(data);
  if (!message) return out;
  for (const auto& each : message->detections) {
    if (!(each.probability >= threshold)) continue;
    Detection detection{each.part, each.probability, {}};
    bool finite = true;
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t k = 0; k < 2; ++k) {
        detection.corners[i][k] = each.corners_sensor[i][k];
        finite = finite && std::isfinite(each.corners_sensor[i][k]);
      }
    }
    if (finite) out.push_back(std::move(detection));
  }
  return out;
}

void compare_detections(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b,
                        const CompareOptions& options, Comparison& all, FrameComparison* frame) {
  auto in_a = detections_of(a, options.threshold);
  for (auto& detection : detections_of(b, options.threshold)) {
    std::size_t best = in_a.size();
    double best_overlap = options.overlap;
    for (std::size_t i = 0; i < in_a.size(); ++i) {
      const double here = in_a[i].part == detection.part ? overlap(in_a[i], detection) : 0;
      if (here >= best_overlap) {
        best = i;
        best_overlap = here;
      }
    }
    auto& part = all.parts[detection.part];
    if (best == in_a.size()) {
      ++all.gained;
      ++part[1];
      if (frame) frame->gained.push_back(std::move(detection));
      continue;
    }
    ++all.kept;
    ++part[0];
    const auto& match = in_a[best];
    all.probability_shift =
        std::max(all.probability_shift, std::abs(match.probability - detection.probability));
    for (std::size_t i = 0; i < 4; ++i) {
      all.corner_shift_px =
          std::max(all.corner_shift_px, std::hypot(match.corners[i][0] - detection.corners[i][0],
                                                   match.corners[i][1] - detection.corners[i][1]));
    }
    in_a.erase(in_a.begin() + static_cast<std::ptrdiff_t>(best));
    if (frame) frame->kept.push_back(std::move(detection));
  }
  all.lost += in_a.size();
  for (auto& detection : in_a) {
    ++all.parts[detection.part][2];
    if (frame) frame->lost.push_back(std::move(detection));
  }
}

void compare_grasps(const std::vector<std::uint8_t>& data_a,
                    const std::vector<std::uint8_t>& data_b, std::vector<double>& shifts_mm) {
  const auto a = decode_message<weft::grasps_t>(data_a), b = decode_message<weft::grasps_t>(data_b);
  if (!a || !b) return;
  for (const auto& grasp : b->grasps) {
    const auto match = std::find_if(a->grasps.begin(), a->grasps.end(), [&](const auto& each) {
      return each.part == grasp.part && each.detection == grasp.detection;
    });
    if (match == a->grasps.end()) continue;
    double sum = 0;
    for (int i = 0; i < 3; ++i)
      sum += std::pow(match->point_camera_m[i] - grasp.point_camera_m[i], 2);
    if (std::isfinite(sum)) shifts_mm.push_back(1000 * std::sqrt(sum));
  }
}

struct PoseShifts {
  std::vector<double> camera_mm, turn_deg;
};

void compare_poses(const std::vector<std::uint8_t>& data_a, const std::vector<std::uint8_t>& data_b,
                   Comparison& all, PoseShifts& shifts) {
  const auto a = decode_message<weft::camera_pose_t>(data_a),
             b = decode_message<weft::camera_pose_t>(data_b);
  if (!a || !b) return;
  const bool in_a = a->state == camera_pose_t::TRACKED, in_b = b->state == camera_pose_t::TRACKED;
  all.poses_gained += in_b && !in_a;
  all.poses_lost += in_a && !in_b;
  if (!in_a || !in_b) return;
  double squares = 0, cosine = 0;  // of half the angle between the two
  for (int i = 0; i < 3; ++i)
    squares += std::pow(a->T_world_camera.translation[i] - b->T_world_camera.translation[i], 2);
  for (int i = 0; i < 4; ++i)
    cosine += a->T_world_camera.rotation[i] * b->T_world_camera.rotation[i];
  if (!std::isfinite(squares) || !std::isfinite(cosine)) return;
  shifts.camera_mm.push_back(1000 * std::sqrt(squares));
  shifts.turn_deg.push_back(2 * std::acos(std::min(1.0, std::abs(cosine))) * 180 /
                            std::numbers::pi);
}

std::string base64(const std::uint8_t* data, std::size_t size) {
  static const char* const digits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < size; i += 3) {
    const std::uint32_t three = static_cast<std::uint32_t>(data[i]) << 16 |
                                (i + 1 < size ? static_cast<std::uint32_t>(data[i + 1]) << 8 : 0) |
                                (i + 2 < size ? data[i + 2] : 0u);
    out += digits[three >> 18];
    out += digits[three >> 12 & 63];
    out += i + 1 < size ? digits[three >> 6 & 63] : '=';
    out += i + 2 < size ? digits[three & 63] : '=';
  }
  return out;
}

/// A table of the text and of the page.
struct Table {
  std::vector<std::string> head;
  std::vector<std::vector<std::string>> rows;
  std::string note;
  std::vector<const std::vector<std::string>*> all_rows() const {
    std::vector<const std::vector<std::string>*> all{&head};
    for (const auto& row : rows) all.push_back(&row);
    return all;
  }
};

/// Latency of the stages of either run, in the order of B, then those of A alone.
Table latency_table(const Comparison& all) {
  Table table{
      {"ms", "A p50", "B p50", "B / A", "A p95", "B p95", "A CPU p50", "B CPU p50"}, {}, ""};
  const auto row = [&](const std::string& name, const Quantiles* a, const Quantiles* b,
                       const Quantiles* cpu_a, const Quantiles* cpu_b) {
    const auto text = [](const Quantiles* q, double Quantiles::*which) {
      return q ? fmt::format("{:.2f}", q->*which) : "";
    };
    table.rows.push_back({name, text(a, &Quantiles::p50), text(b, &Quantiles::p50),
                          a && b && a->p50 > 0 ? fmt::format("{:.2f}", b->p50 / a->p50) : "",
                          text(a, &Quantiles::p95), text(b, &Quantiles::p95),
                          text(cpu_a, &Quantiles::p50), text(cpu_b, &Quantiles::p50)});
  };
  const auto find = [](const TimingReport& report, const std::string& name) {
    const auto at = std::find_if(report.stages.begin(), report.stages.end(),
                                 [&](const auto& each) { return each.stage == name; });
    return at == report.stages.end() ? nullptr : &*at;
  };
  for (const auto& b : all.timing_b.stages) {
    const auto* a = find(all.timing_a, b.stage);
    row(b.stage, a ? &a->work : nullptr, &b.work, a ? &a->cpu : nullptr, &b.cpu);
  }
  for (const auto& a : all.timing_a.stages) {
    if (!find(all.timing_b, a.stage)) row(a.stage, &a.work, nullptr, &a.cpu, nullptr);
  }
  if (!all.timing_a.frames.empty() && !all.timing_b.frames.empty())
    row("end to end", &all.timing_a.end_to_end, &all.timing_b.end_to_end, nullptr, nullptr);
  if (!table.rows.empty())
    table.note = fmt::format("throughput: A {:.1f}, B {:.1f} frames/s\n",
                             all.timing_a.frames_per_second, all.timing_b.frames_per_second);
  return table;
}

using Score = std::optional<double> evaluation::PartScore::*;
constexpr std::pair<const char*, Score> kScores[] = {
    {"recall_at_1", &evaluation::PartScore::recall_at_1},
    {"recall_at_3", &evaluation::PartScore::recall_at_3},
    {"recall_at_5", &evaluation::PartScore::recall_at_5},
    {"ap", &evaluation::PartScore::ap}};

/// Percent in A and in B, and how much more in B.
Table truth_table(const Comparison& all) {
  Table table;
  if (!all.truth) return table;
  const auto& truth = *all.truth;
  const auto put = [](std::vector<std::string>& row, const std::optional<double>& a,
                      const std::optional<double>& b) {
    row.push_back(a ? fmt::format("{:.1f}", 100 * *a) : "");
    row.push_back(b ? fmt::format("{:.1f}", 100 * *b) : "");
    row.push_back(a && b ? fmt::format("{:+.1f}", 100 * (*b - *a)) : "");
  };
  table.head = {"against the truth, %",
                "images",
                "A R@1",
                "B R@1",
                "B - A",
                "A R@3",
                "B R@3",
                "B - A",
                "A AP",
                "B AP",
                "B - A"};
  for (std::size_t i = 0; i < truth.a.parts.size(); ++i) {
    const auto &a = truth.a.parts[i], &b = truth.b.parts[i];
    if (a.positives == 0) continue;
    std::vector<std::string> row{a.part, std::to_string(a.positive_images)};
    put(row, a.recall_at_1, b.recall_at_1);
    put(row, a.recall_at_3, b.recall_at_3);
    put(row, a.ap, b.ap);
    table.rows.push_back(std::move(row));
  }
  std::vector<std::string> mean{"mean", std::to_string(truth.images)};
  put(mean, truth.a.mean_recall_at_1, truth.b.mean_recall_at_1);
  put(mean, std::nullopt, std::nullopt);
  put(mean, truth.a.map, truth.b.map);
  table.rows.push_back(std::move(mean));
  const auto gained = static_cast<std::size_t>(std::count_if(
      truth.changes.begin(), truth.changes.end(), [](const auto& each) { return each.gained; }));
  table.note =
      fmt::format("best detection of a part: right in B alone in {} images, in A alone in {}\n",
                  gained, truth.changes.size() - gained);
  if (truth.failed_a + truth.failed_b > 0)
    table.note +=
        fmt::format("without an answer: {} images in A, {} in B\n", truth.failed_a, truth.failed_b);
  return table;
}

nlohmann::json to_json(const Table& table) {
  return {{"head", table.head}, {"rows", table.rows}, {"note", table.note}};
}

ordered_json to_json(const TruthComparison& truth) {
  const auto number = [](const std::optional<double>& value) {
    return value ? ordered_json(*value) : ordered_json(nullptr);
  };
  const auto entry = [&](const std::optional<double>& a, const std::optional<double>& b) {
    return ordered_json{{"a", number(a)},
                        {"b", number(b)},
                        {"difference", a && b ? ordered_json(*b - *a) : ordered_json(nullptr)}};
  };
  ordered_json json{
      {"images", truth.images},
      {"failed_a", truth.failed_a},
      {"failed_b", truth.failed_b},
      {"map", entry(truth.a.map, truth.b.map)},
      {"mean_recall_at_1", entry(truth.a.mean_recall_at_1, truth.b.mean_recall_at_1)}};
  for (std::size_t i = 0; i < truth.a.parts.size(); ++i) {
    const auto &a = truth.a.parts[i], &b = truth.b.parts[i];
    auto& part = json["parts"][a.part];
    part["positives"] = a.positives;
    for (const auto& [name, score] : kScores) part[name] = entry(a.*score, b.*score);
  }
  json["changes"] = ordered_json::array();
  for (const auto& each : truth.changes)
    json["changes"].push_back(
        {{"image", each.image}, {"part", each.part}, {"right_in", each.gained ? "b" : "a"}});
  return json;
}

nlohmann::json to_json(const std::vector<Detection>& detections) {
  auto list = nlohmann::json::array();
  for (const auto& each : detections)
    list.push_back(
        {{"part", each.part}, {"probability", each.probability}, {"corners", each.corners}});
  return list;
}

}  // namespace

double overlap(const Detection& a, const Detection& b) {
  const auto box = [](const Detection& d) {
    std::array<double, 4> at{std::numeric_limits<double>::max(), std::numeric_limits<double>::max(),
                             std::numeric_limits<double>::lowest(),
                             std::numeric_limits<double>::lowest()};
    for (const auto& [x, y] : d.corners)
      at = {std::min(at[0], x), std::min(at[1], y), std::max(at[2], x), std::max(at[3], y)};
    return at;
  };
  const auto p = box(a), q = box(b);
  const double width = std::min(p[2], q[2]) - std::max(p[0], q[0]);
  const double height = std::min(p[3], q[3]) - std::max(p[1], q[1]);
  if (width <= 0 || height <= 0) return 0;
  const double both = width * height;
  return both / ((p[2] - p[0]) * (p[3] - p[1]) + (q[2] - q[0]) * (q[3] - q[1]) - both);
}

bool Comparison::same() const {
  return std::all_of(channels.begin(), channels.end(), [](const auto& entry) {
    return entry.second.different + entry.second.only_a + entry.second.only_b == 0;
  });
}

Comparison compare_logs(const std::string& log_a, const std::string& log_b,
                        const CompareOptions& options, const MessageTypes& types) {
  Comparison all;
  const std::string suffix = options.variant.empty() ? "" : "@" + options.variant;
  const std::string& file_b = suffix.empty() ? log_b : log_a;
  all.name_a = log_a;
  all.name_b = suffix.empty() ? log_b : log_a + ", " + suffix;
  LogIndex a(log_a), b(file_b);
  for (const auto* index : {&a, &b}) {
    for (const auto& damage : index->damage)
      all.damage.push_back(fmt::format("{}: {} bytes skipped at byte {}: {}", index->file,
                                       damage.bytes, damage.offset, damage.what));
    if (!suffix.empty()) break;
  }
  if (!suffix.empty()) {
    // B: the variant's channels under the names of the baseline's; A: those of the same names.
    std::set<std::string> channels;
    std::vector<LogKey> order;
    std::map<LogKey, LogIndex::Place> places;
    for (auto key : b.order) {
      if (!key.channel.ends_with(suffix)) continue;
      const auto place = b.places.at(key);
      key.channel.resize(key.channel.size() - suffix.size());
      channels.insert(key.channel);
      places[key] = place;
      order.push_back(std::move(key));
    }
    if (order.empty())
      throw Error(log_a + ": has no channel that ends with " + suffix +
                  "; weft log info lists its channels");
    b.order = std::move(order);
    b.places = std::move(places);
    std::erase_if(a.order, [&](const LogKey& key) { return !channels.contains(key.channel); });
    std::erase_if(a.places,
                  [&](const auto& entry) { return !channels.contains(entry.first.channel); });
  }
  stage::LogReader reader_a(log_a), reader_b(file_b);
  std::map<FrameName, std::size_t> different;
  std::set<FrameName> frames;
  std::vector<double> shifts_mm;
  PoseShifts poses;
  const auto frame_of = [&](const LogKey& key) {
    const auto [at, is_new] = different.emplace(key.frame, all.different.size());
    if (is_new) {
      all.different.emplace_back();
      all.different.back().frame = key.frame;
      all.different.back().source_a = log_a;
    }
    auto& channels = all.different[at->second].channels;
    if (std::find(channels.begin(), channels.end(), key.channel) == channels.end())
      channels.push_back(key.channel);
    return at->second;
  };
  for (const auto& key : a.order) {
    frames.insert(key.frame);
    auto& channel = all.channels[key.channel];
    const auto& here = a.places.at(key);
    const auto other = b.places.find(key);
    if (other == b.places.end()) {
      ++channel.only_a;
      frame_of(key);
      continue;
    }
    const auto& there = other->second;
    const bool equal = here.hash == there.hash && here.size == there.size;
    ++(equal ? channel.equal : channel.different);
    const auto index = equal ? all.different.size() : frame_of(key);
    const auto data_a = read_payload(reader_a, here);
    if (channel.type.empty()) channel.type = types.type_of(data_a);
    const auto data_b = equal ? data_a : read_payload(reader_b, there);
    compare_detections(data_a, data_b, options, all, equal ? nullptr : &all.different[index]);
    compare_grasps(data_a, data_b, shifts_mm);
    compare_poses(data_a, data_b, all, poses);
    if (equal) continue;
    const auto header_a = read_frame_header(data_a), header_b = read_frame_header(data_b);
    channel.other_status += header_a && header_b && header_a->status_code != header_b->status_code;
    const auto decoded_a = types.decode(data_a), decoded_b = types.decode(data_b);
    if (!decoded_a || !decoded_b) continue;
    std::set<std::string> fields;
    for (const auto& each : field_differences(decoded_a->fields, decoded_b->fields))
      fields.insert(without_indices(each.path));
    for (const auto& field : fields) ++channel.fields[field];
  }
  for (const auto& key : b.order) {
    frames.insert(key.frame);
    if (a.places.contains(key)) continue;
    ++all.channels[key.channel].only_b;
    frame_of(key);
  }
  all.frames = frames.size();
  all.grasps = shifts_mm.size();
  all.grasp_shift_mm = quantiles(shifts_mm);
  all.poses = poses.camera_mm.size();
  all.camera_shift_mm = quantiles(poses.camera_mm);
  all.camera_turn_deg = quantiles(poses.turn_deg);
  std::set<std::string> variants;
  all.timing_b = read_timing(file_b, suffix, {});
  if (!suffix.empty()) {
    for (const auto& stage : all.timing_b.stages) variants.insert(stage.stage + suffix);
  }
  all.timing_a = read_timing(log_a, "", variants);
  if (!suffix.empty()) {
    std::set<std::string> replaced;
    for (const auto& stage : all.timing_b.stages) replaced.insert(stage.stage);
    measure_to(all.timing_a, log_a, replaced);
    measure_to(all.timing_b, log_a, variants);
  }
  if (!options.truth.empty())
    all.truth = compare_with_truth(log_a, options.channel, file_b, options.channel + suffix,
                                   options.truth, options.threshold);
  return all;
}

namespace {

std::string channels_text(const Comparison& all) {
  std::string text = fmt::format("A: {}\nB: {}\n\n", all.name_a, all.name_b);
  text +=
      fmt::format("{:<24} {:<20} {:>7} {:>9} {:>7} {:>7} {:>12}  {}\n", "channel", "type", "equal",
                  "different", "only A", "only B", "other status", "fields that differ (messages)");
  for (const auto& [name, channel] : all.channels) {
    std::string fields;
    std::vector<std::pair<std::size_t, std::string>> sorted;
    for (const auto& [field, count] : channel.fields) sorted.emplace_back(count, field);
    std::stable_sort(sorted.begin(), sorted.end(),
                     [](const auto& p, const auto& q) { return p.first > q.first; });
    for (std::size_t i = 0; i < std::min<std::size_t>(sorted.size(), 4); ++i)
      fields += fmt::format("{}{} ({})", i ? ", " : "", sorted[i].second, sorted[i].first);
    if (sorted.size() > 4) fields += fmt::format(" and {} more", sorted.size() - 4);
    text += fmt::format("{:<24} {:<20} {:>7} {:>9} {:>7} {:>7} {:>12}  {}\n", name, channel.type,
                        channel.equal, channel.different, channel.only_a, channel.only_b,
                        channel.other_status, fields);
  }
  text += fmt::format("\n{} of {} frames differ", all.different.size(), all.frames);
  for (std::size_t i = 0; i < std::min<std::size_t>(all.different.size(), 10); ++i)
    text += (i == 0 ? ": " : ", ") + std::to_string(all.different[i].frame.seq);
  text += all.different.size() > 10 ? ", ...\n" : "\n";
  if (all.kept + all.gained + all.lost > 0) {
    text += fmt::format(
        "detections: {} in both, {} gained, {} lost; those in both changed by up to {:.3f} in "
        "probability, {:.1f} px at a corner\n",
        all.kept, all.gained, all.lost, all.probability_shift, all.corner_shift_px);
    for (const auto& [part, count] : all.parts) {
      if (count[1] + count[2] > 0)
        text += fmt::format("  {:<22} {:>5} in both, {} gained, {} lost\n", part, count[0],
                            count[1], count[2]);
    }
  }
  if (all.grasps > 0)
    text += fmt::format("grasp points: {} in both, moved by {:.1f} mm median, {:.1f} at most\n",
                        all.grasps, all.grasp_shift_mm.p50, all.grasp_shift_mm.max);
  if (all.poses + all.poses_gained + all.poses_lost > 0)
    text += fmt::format(
        "camera poses: {} tracked in both, {} gained, {} lost; moved by {:.1f} mm median, {:.1f} "
        "at most, turned by {:.2f} deg median, {:.2f} at most\n",
        all.poses, all.poses_gained, all.poses_lost, all.camera_shift_mm.p50,
        all.camera_shift_mm.max, all.camera_turn_deg.p50, all.camera_turn_deg.max);
  return text;
}

}  // namespace

std::string to_text(const Comparison& all) {
  std::string text = channels_text(all);
  for (const auto& table : {truth_table(all), latency_table(all)}) {
    if (table.rows.empty()) continue;
    text += "\n";
    for (const auto* row : table.all_rows()) {
      for (std::size_t i = 0; i < row->size(); ++i)
        text += i == 0 ? fmt::format("{:<22}", (*row)[i]) : fmt::format(" {:>9}", (*row)[i]);
      text += "\n";
    }
    text += table.note;
  }
  return text;
}

std::string to_json(const Comparison& all) {
  ordered_json json{{"a", all.name_a},
                    {"b", all.name_b},
                    {"same", all.same()},
                    {"frames", all.frames},
                    {"frames_different", all.different.size()},
                    {"detections_kept", all.kept},
                    {"detections_gained", all.gained},
                    {"detections_lost", all.lost},
                    {"probability_shift", all.probability_shift},
                    {"corner_shift_px", all.corner_shift_px},
                    {"grasps", all.grasps},
                    {"grasp_shift_p50_mm", all.grasp_shift_mm.p50},
                    {"grasp_shift_max_mm", all.grasp_shift_mm.max},
                    {"poses", all.poses},
                    {"poses_gained", all.poses_gained},
                    {"poses_lost", all.poses_lost},
                    {"camera_shift_p50_mm", all.camera_shift_mm.p50},
                    {"camera_shift_max_mm", all.camera_shift_mm.max},
                    {"camera_turn_p50_deg", all.camera_turn_deg.p50},
                    {"camera_turn_max_deg", all.camera_turn_deg.max}};
  json["channels"] = ordered_json::object();
  for (const auto& [name, channel] : all.channels) {
    json["channels"][name] = {
        {"type", channel.type},           {"equal", channel.equal},
        {"different", channel.different}, {"only_a", channel.only_a},
        {"only_b", channel.only_b},       {"other_status", channel.other_status},
        {"fields", channel.fields}};
  }
  json["parts"] = ordered_json::object();
  for (const auto& [part, count] : all.parts)
    json["parts"][part] = {{"kept", count[0]}, {"gained", count[1]}, {"lost", count[2]}};
  json["different"] = ordered_json::array();
  for (const auto& each : all.different) {
    json["different"].push_back({{"frame", to_string(each.frame)},
                                 {"channels", each.channels},
                                 {"gained", each.gained.size()},
                                 {"lost", each.lost.size()}});
  }
  for (const auto* side : {"a", "b"}) {
    const auto& report = *side == 'a' ? all.timing_a : all.timing_b;
    const auto timing = ordered_json::parse(to_json(report));
    json["stages_" + std::string(side)] = timing["stages"];
    json["end_to_end_" + std::string(side)] = timing["end_to_end"];
    json["frames_per_second_" + std::string(side)] = report.frames_per_second;
  }
  if (all.truth) json["truth"] = to_json(*all.truth);
  return json.dump(2);
}

std::string to_page(const Comparison& all, std::size_t pictures) {
  std::vector<const FrameComparison*> shown;
  for (const auto& frame : all.different) {
    if (!frame.frame.camera.empty()) shown.push_back(&frame);
  }
  std::stable_sort(shown.begin(), shown.end(),
                   [](const auto* a, const auto* b) { return a->change() > b->change(); });
  shown.resize(std::min(shown.size(), pictures));
  // The colour images, from one pass over A.
  std::map<FrameName, std::vector<weft::rgbd_frame_t>> images;
  if (!shown.empty()) {
    std::set<FrameName> wanted;
    for (const auto* frame : shown) wanted.insert(frame->frame);
    stage::LogReader log(shown.front()->source_a);
    for (stage::LogEvent event; log.next(event);) {
      const auto name = read_frame_name(event.data);
      if (!name || !wanted.contains(*name)) continue;
      if (auto part = decode_message<weft::rgbd_frame_t>(event.data))
        images[*name].push_back(std::move(*part));
    }
  }
  nlohmann::json page{{"text", channels_text(all)},
                      {"truth", to_json(truth_table(all))},
                      {"latency", to_json(latency_table(all))},
                      {"frames", nlohmann::json::array()}};
  page["summary"] = fmt::format("{} of {} frames differ; {} detections gained, {} lost, {} in both",
                                all.different.size(), all.frames, all.gained, all.lost, all.kept);
  page["hidden"] = all.different.size() - shown.size();
  for (const auto* frame : shown) {
    nlohmann::json entry{{"name", to_string(frame->frame)},
                         {"channels", frame->channels},
                         {"kept", to_json(frame->kept)},
                         {"gained", to_json(frame->gained)},
                         {"lost", to_json(frame->lost)},
                         {"image", ""},
                         {"source", ""},
                         {"truth", nlohmann::json::array()},
                         {"width", 640},
                         {"height", 480}};
    PlayedFrame played;
    for (auto& part : images[frame->frame])
      played.source.events.push_back({0, 0, "RGBD_FRAME", encode_message(part)});
    if (const auto content = read_content(played); content.rgbd) {
      const auto& rgbd = *content.rgbd;
      entry["source"] = rgbd.source;
      if (all.truth && all.truth->polygons.contains(rgbd.source)) {
        for (const auto& polygon : all.truth->polygons.at(rgbd.source)) {
          if (polygon.ignore) continue;
          auto points = nlohmann::json::array();
          for (const auto& point : polygon.points) points.push_back({point.x, point.y});
          entry["truth"].push_back({{"part", polygon.part}, {"points", points}});
        }
      }
      entry["width"] = rgbd.camera_model.width;
      entry["height"] = rgbd.camera_model.height;
      const bool jpeg = rgbd.colour_encoding == weft::rgbd_frame_t::COLOUR_JPEG;
      if (jpeg || rgbd.colour_encoding == weft::rgbd_frame_t::COLOUR_PNG)
        entry["image"] = std::string("data:image/") + (jpeg ? "jpeg" : "png") + ";base64," +
                         base64(rgbd.data.data(), static_cast<std::size_t>(rgbd.colour_size));
    }
    page["frames"].push_back(std::move(entry));
  }
  return make_page("compare.html", page);
}

}  // namespace weft
