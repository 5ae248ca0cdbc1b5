#include "dataset/iri.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "base/error.hpp"
#include "base/text_file.hpp"
#include "rgbd/pcd_io.hpp"

namespace weft::dataset {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kMaxPoints = 10'000;
constexpr std::size_t kMaxBytes = 1 << 20;  // of an annotation

std::string lower(std::string s) {
  for (char& c : s) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return s;
}

std::string trim(const std::string& s) {
  const auto first = s.find_first_not_of(" \t\r\"'");
  if (first == std::string::npos) return "";
  return s.substr(first, s.find_last_not_of(" \t\r\"',;") - first + 1);
}

class Line {
 public:
  Line(const std::string& where, int number, std::string value)
      : where_(where), number_(number), value_(std::move(value)) {}

  [[noreturn]] void fail(const std::string& expected) const {
    throw Error(where_ + ":" + std::to_string(number_) + ": \"" + value_.substr(0, 60) +
                "\": expected " + expected);
  }
  const std::string& text() const { return value_; }
  bool truth() const {
    const std::string v = lower(value_);
    if (v == "yes" || v == "true" || v == "1") return true;
    if (v == "no" || v == "false" || v == "0") return false;
    fail("yes or no");
  }
  std::vector<double> numbers() const {
    std::vector<double> out;
    const char *at = value_.data(), *end = at + value_.size();
    while (true) {
      while (at != end && std::string_view(" \t,;()[]").find(*at) != std::string_view::npos) ++at;
      if (at == end) return out;
      double v = 0.0;
      const auto [next, error] = std::from_chars(at, end, v);
      if (error != std::errc() || !std::isfinite(v)) fail("numbers");
      if (out.size() >= 2 * kMaxPoints) fail("fewer numbers");
      out.push_back(v);
      at = next;
    }
  }

 private:
  const std::string& where_;
  int number_;
  std::string value_;
};

std::string number(double v) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.9g", v);
  return buffer;
}

void write_png(const std::string& path, const cv::Mat& image) {
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".png", image, bytes, {cv::IMWRITE_PNG_COMPRESSION, 4})) {
    throw Error(path + ": cannot be encoded as PNG");
  }
  write_text_file(path, {bytes.begin(), bytes.end()});
}

class IriDataset : public Dataset {
 public:
  explicit IriDataset(std::string folder) : folder_(std::move(folder)) {
    for (const auto& entry : fs::directory_iterator(fs::path(folder_) / "annotations")) {
      if (entry.path().extension() == ".txt") names_.push_back(entry.path().stem().string());
    }
    std::sort(names_.begin(), names_.end());
    if (names_.empty()) throw Error(folder_ + ": annotations/ holds no .txt file");
  }
  const std::vector<std::string>& names() const override { return names_; }

  Scene read(std::size_t index) const override {
    Scene scene;
    scene.name = names_.at(index);
    const std::string annotation = path("annotations", ".txt", scene.name);
    std::error_code error;
    const auto size = fs::file_size(annotation, error);
    if (error || size > kMaxBytes) throw Error(annotation + ": unreadable, or larger than 1 MiB");
    std::ifstream in(annotation, std::ios::binary);
    std::stringstream text;
    text << in.rdbuf();
    IriAnnotation a = parse_iri_annotation(text.str(), annotation);
    const std::string pcd = path("pcd", ".pcd", scene.name);
    const rgbd::Cloud cloud = rgbd::read_pcd(pcd);
    const rgbd::CameraModel camera = a.camera ? *a.camera : rgbd::fit_camera(cloud, pcd).camera;
    scene.frame = rgbd::frame_from_cloud(cloud, camera, 0.001, pcd);
    const cv::Size expected(camera.width, camera.height);
    scene.frame.colour = image(path("png", ".png", scene.name), cv::IMREAD_COLOR, expected);
    const std::string mask = path("masks", ".png", scene.name);
    if (fs::exists(mask)) scene.frame.mask = image(mask, cv::IMREAD_GRAYSCALE, expected);
    scene.frame.source = scene.name;
    scene.polygons = std::move(a.polygons);
    scene.garment = a.garment;
    scene.simulation = a.simulation;
    scene.split = a.split;
    scene.easy = a.easy;
    scene.single = a.single;
    return scene;
  }

 private:
  std::string path(const char* kind, const char* extension, const std::string& name) const {
    return (fs::path(folder_) / kind / (name + extension)).string();
  }
  static cv::Mat image(const std::string& file, int mode, const cv::Size& expected) {
    cv::Mat out = cv::imread(file, mode);
    if (out.empty()) throw Error(file + ": not there or not a PNG");
    if (out.size() != expected) {
      throw Error(file + ": " + std::to_string(out.cols) + "x" + std::to_string(out.rows) +
                  " px, the scene's camera has " + std::to_string(expected.width) + "x" +
                  std::to_string(expected.height));
    }
    return out;
  }

  std::string folder_;
  std::vector<std::string> names_;
};

}  // namespace

IriAnnotation parse_iri_annotation(const std::string& text, const std::string& where) {
  IriAnnotation a;
  PartPolygon* part = nullptr;
  rgbd::CameraModel camera;
  bool has_size = false, has_camera = false;
  std::istringstream in(text);
  std::string raw;
  for (int n = 1; std::getline(in, raw); ++n) {
    raw = trim(raw.substr(0, raw.find('#')));
    if (raw.empty()) continue;
    const auto colon = raw.find_first_of(":=");
    if (colon == std::string::npos) Line(where, n, raw).fail("key: value");
    const std::string key = lower(trim(raw.substr(0, colon)));
    const Line line(where, n, trim(raw.substr(colon + 1)));
    const auto of_part = [&]() -> PartPolygon& {
      if (part == nullptr) line.fail("a \"part:\" line before \"" + key + ":\"");
      return *part;
    };
    if (key == "part") {
      std::string name = lower(line.text());
      std::replace(name.begin(), name.end(), '_', ' ');
      if (name.empty()) line.fail("the name of a part");
      part = &a.polygons.emplace_back();
      part->part = name;
    } else if (key == "instance") {
      of_part().instance = line.text();
    } else if (key == "ignore") {
      of_part().ignore = line.truth();
    } else if (key == "visible") {
      const auto v = line.numbers();
      if (v.size() != 1 || v[0] < 0.0 || v[0] > 1.0) line.fail("a share from 0 to 1");
      of_part().visible_share = v[0];
    } else if (key == "polygon") {
      const auto v = line.numbers();
      if (v.size() % 2 != 0) line.fail("pairs of numbers");
      for (std::size_t i = 0; i < v.size(); i += 2) {
        of_part().points.emplace_back(static_cast<float>(v[i]), static_cast<float>(v[i + 1]));
      }
    } else if (key == "size") {
      const auto v = line.numbers();
      if (v.size() != 2 || v[0] < 1 || v[1] < 1 || v[0] > 8192 || v[1] > 8192) {
        line.fail("width and height, px");
      }
      camera.width = static_cast<int>(v[0]);
      camera.height = static_cast<int>(v[1]);
      has_size = true;
    } else if (key == "camera") {
      const auto v = line.numbers();
      if (v.size() != 4) line.fail("fx fy cx cy, px");
      camera.fx = v[0];
      camera.fy = v[1];
      camera.cx = v[2];
      camera.cy = v[3];
      has_camera = true;
    } else if (key == "garment") {
      a.garment = line.text();
    } else if (key == "simulation") {
      a.simulation = line.text();
    } else if (key == "split") {
      a.split = line.text();
    } else if (key == "easy") {
      a.easy = line.truth();
    } else if (key == "single") {
      a.single = line.truth();
    }
  }
  for (const auto& p : a.polygons) {
    if (p.points.size() < 3) {
      throw Error(where + ": part " + p.part + " " + p.instance + " has a polygon of " +
                  std::to_string(p.points.size()) + " points; at least 3 are needed");
    }
  }
  if (has_camera && !has_size) throw Error(where + ": camera: without size:");
  if (has_camera) {
    camera.validate(where);
    a.camera = camera;
  }
  return a;
}

std::string format_iri_annotation(const Scene& scene) {
  const auto& c = scene.frame.camera;
  const auto yes = [](bool v) { return v ? "yes" : "no"; };
  std::string out =
      "# Ground truth of a garment scan. Pixel (0, 0) is the centre of the top left pixel.\n"
      "# camera: fx fy cx cy of the pinhole that took both colour and depth, px.\n"
      "# easy: of the Easy subset; single: shows one garment only (Complete subset).\n"
      "# Of each part: visible = share of its surface that is seen (1 = all that a flat garment\n"
      "# would show), ignore = neither hit, miss nor negative, polygon = x y pairs in px.\n"
      "# In labels/NAME.png 0 is the background, 64 the garment beside its parts, k its k-th part\n"
      "# instance in the manifest's order; 128 is added on the inside face of the cloth.\n";
  out += "size: " + std::to_string(c.width) + " " + std::to_string(c.height) + "\n";
  out += "camera: " + number(c.fx) + " " + number(c.fy) + " " + number(c.cx) + " " + number(c.cy) +
         "\n";
  out += "garment: " + scene.garment + "\n";
  out += "simulation: " + scene.simulation + "\n";
  out += "split: " + scene.split + "\n";
  out += std::string("easy: ") + yes(scene.easy) + "\n";
  out += std::string("single: ") + yes(scene.single) + "\n";
  for (const auto& p : scene.polygons) {
    out += "\npart: " + p.part + "\n";
    out += "  instance: " + p.instance + "\n";
    out += "  visible: " + number(p.visible_share) + "\n";
    out += std::string("  ignore: ") + yes(p.ignore) + "\n  polygon:";
    for (const auto& q : p.points) {
      out += " " + number(static_cast<double>(q.x)) + " " + number(static_cast<double>(q.y)) + ",";
    }
    out.back() = '\n';
  }
  return out;
}

bool is_iri(const std::string& folder) {
  const fs::path root(folder);
  return fs::is_directory(root / "annotations") && fs::is_directory(root / "png") &&
         fs::is_directory(root / "pcd");
}

std::unique_ptr<Dataset> open_iri(const std::string& folder) {
  if (!is_iri(folder)) {
    throw Error(folder + ": not an IRI data set: looked for png/, pcd/ and annotations/");
  }
  return std::make_unique<IriDataset>(folder);
}

void write_iri(const std::string& folder, const Scene& scene, const cv::Mat& labels) {
  const fs::path root(folder);
  const auto path = [&](const char* kind, const char* extension) {
    fs::create_directories(root / kind);
    return (root / kind / (scene.name + extension)).string();
  };
  write_png(path("png", ".png"), scene.frame.colour);
  if (!scene.frame.mask.empty()) write_png(path("masks", ".png"), scene.frame.mask);
  if (!labels.empty()) write_png(path("labels", ".png"), labels);
  const std::string pcd = path("pcd", ".pcd");
  rgbd::write_pcd(pcd + ".tmp", rgbd::cloud_from_frame(scene.frame),
                  rgbd::PcdEncoding::kBinaryCompressed);
  fs::rename(pcd + ".tmp", pcd);
  write_text_file(path("annotations", ".txt"), format_iri_annotation(scene));
}

}  // namespace weft::dataset
