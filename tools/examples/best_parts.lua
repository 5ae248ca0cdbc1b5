#!/usr/bin/env lua5.2
-- A stage in another language: keeps the most probable detection of each part. It knows Weft by its .lcm files alone
-- and keeps the stage contract (docs/stage-contract.md). Debian: liblcm-lua liblcm-bin lua5.2 lua-socket.
--
--   - {name: best, exec: ../../tools/examples/best_parts.lua, with: {threshold: 0.6},
--      map: {BEST_PARTS: "PART_DETECTIONS@best"}}
local folder = arg[0]:match('^(.*)/') or '.'
local lcm = require('lcm')
local socket = require('socket')
unpack = table.unpack -- lcm-gen writes for Lua 5.1

-- A number of Lua 5.2 holds 53 bits. A 64-bit field that needs more (a hash) is kept as its eight bytes, so that it
-- leaves as it came.
local pack_plain, unpack_plain = lcm._pack.pack, lcm._pack.unpack
local sizes = {b = 1, B = 1, ['?'] = 1, h = 2, i = 4, I = 4, q = 8, f = 4, d = 8, X = 8}
local function each_field(format)
  return coroutine.wrap(function()
    for count, letter in format:gmatch('(%d*)([%a?])') do
      for _ = 1, tonumber(count) or 1 do coroutine.yield(letter) end
    end
  end)
end
function lcm._pack.pack(format, ...)
  local values, bytes = {...}, {}
  for letter in each_field(format) do
    local value = values[#bytes + 1]
    table.insert(bytes, letter == 'q' and type(value) == 'string' and value or pack_plain('>' .. letter, value))
  end
  return table.concat(bytes)
end
function lcm._pack.unpack(format, bytes)
  local values, at = {}, 1
  for letter in each_field(format) do
    local field = bytes:sub(at, at + sizes[letter] - 1)
    at = at + #field
    local first, second = field:byte(1, 2)
    local wide = letter == 'q' and not (first == 0 and second < 0x20 or first == 0xff and second >= 0xe0)
    table.insert(values, wide and field or unpack_plain('>' .. letter, field))
  end
  return unpack(values)
end

local function load_types()
  local out = os.tmpname()
  os.remove(out)
  local command = ("lcm-gen --lua --lpath '%s' '%s'/../../lcmtypes/*.lcm >/dev/null"):format(out, folder)
  if not os.execute(command) then error('lcm-gen failed: ' .. command, 0) end
  package.path = out .. '/?.lua;' .. out .. '/?/init.lua;' .. package.path
  local loaded, types = pcall(require, 'weft')
  os.execute(("rm -r '%s'"):format(out))
  return loaded and types or error(types, 0)
end

local function wrong_use(text)
  io.stderr:write('best_parts: ', text, '\n')
  os.exit(2)
end

-- The options of every stage. Those about lateness have no use here: the work takes no time and needs one input.
local name, url, threshold = 'best_parts', os.getenv('LCM_DEFAULT_URL') or 'udpm://239.255.76.67:7667?ttl=0', 0
local map = {}
local i = 1
while i <= #arg do
  local option, value = arg[i], arg[i + 1]
  if option == '--lock-step' then
    i = i + 1
  else
    if not value then wrong_use(option .. ' needs a value') end
    i = i + 2
    if option == '--name' then
      name = value
    elseif option == '--url' then
      url = value
    elseif option == '--map' then
      local from, to = value:match('^(.-)=(.+)$')
      if from ~= 'PART_DETECTIONS' and from ~= 'BEST_PARTS' then
        wrong_use('--map ' .. value .. ': the channels are PART_DETECTIONS and BEST_PARTS')
      end
      map[from] = to
    elseif option == '--set' then
      local key, number = value:match('^%s*(.-)%s*[=:]%s*(.-)%s*$')
      threshold = key == 'threshold' and tonumber(number) or -1
      if not (threshold >= 0 and threshold <= 1) then
        wrong_use('--set ' .. value .. ': the one setting is threshold, a probability from 0 to 1')
      end
    elseif option ~= '--queue' and option ~= '--deadline-ms' and option ~= '--log-level' then
      wrong_use('unknown option ' .. option)
    end
  end
end
local input, output = map.PART_DETECTIONS or 'PART_DETECTIONS', map.BEST_PARTS or 'BEST_PARTS'

local weft = load_types()
local OK, NOTHING, FAILED, MISSING_INPUT = 0, 1, 2, 4 -- lcm-gen writes no constants for Lua
local INVALID_INPUT, UPSTREAM_FAILED, NOTHING_FOUND = 2, 3, 23
local codes = {[FAILED] = 'FAILED', [3] = 'DROPPED', [MISSING_INPUT] = 'MISSING_INPUT'}

local function now_us() return math.floor(socket.gettime() * 1e6) end

local function stage_answer(header, code, reason, text)
  local out = weft.part_detections_t:new()
  out.header, out.status, out.view = header, weft.status_t:new(), weft.view_t:new()
  out.view.sensor, out.view.table = weft.camera_model_t:new(), weft.plane_t:new()
  out.status.code, out.status.reason, out.status.text = code, reason, text
  return out
end

-- From a message to the answer: a pure function of it and the threshold.
local function process(found)
  local code = found.status.code
  if code ~= OK and code ~= NOTHING then
    local text = ('PART_DETECTIONS is %s: %s'):format(codes[code] or 'unknown', found.status.text)
    return stage_answer(found.header, MISSING_INPUT, UPSTREAM_FAILED, text)
  end
  local best, order = {}, {}
  for _, detection in ipairs(found.detections) do
    local probability, part = detection.probability, detection.part
    if not (probability >= 0 and probability <= 1) then
      return stage_answer(found.header, FAILED, INVALID_INPUT, 'PART_DETECTIONS: a probability is not from 0 to 1')
    end
    if probability >= threshold then
      if not best[part] then table.insert(order, part) end
      if not best[part] or probability > best[part].probability then best[part] = detection end
    end
  end
  local out = stage_answer(found.header, OK, 0, '')
  if #order == 0 then out = stage_answer(found.header, NOTHING, NOTHING_FOUND, 'no detection reaches the threshold') end
  out.model_hash, out.view, out.detection_count = found.model_hash, found.view, #order
  for _, part in ipairs(order) do table.insert(out.detections, best[part]) end
  table.sort(out.detections, function(a, b)
    if a.probability ~= b.probability then return a.probability > b.probability end
    return a.part < b.part
  end)
  return out
end

-- The prefix is Weft's own piece of the URL: the robot's name before every channel's.
local robot = url:match('&prefix=([%w_-]+)')
local prefix = robot and robot .. '/' or ''
local bus = lcm.lcm.new((url:gsub('&prefix=[%w_-]+', '')))
local status = weft.stage_status_t:new()
status.header = weft.header_t:new()
status.header.session, status.header.seq = now_us(), -1
status.stage, status.host, status.pid = name, socket.dns.gethostname(), 0
for pid in io.lines('/proc/self/stat') do status.pid = tonumber(pid:match('^%d+')) end
status.started_utime = status.header.session
status.build = _VERSION
status.settings_hash = math.floor(threshold * 2 ^ 40)
for direction, channel in pairs({[0] = input, [1] = output}) do
  local port = weft.type_fingerprint_t:new()
  port.direction, port.channel, port.type = direction, channel, 'part_detections_t'
  port.fingerprint = weft.part_detections_t._packed_fingerprint
  table.insert(status.fingerprints, port)
end
status.fingerprint_count = 2

local function publish_status(state)
  status.state = state
  status.header.utime, status.header.seq = now_us(), status.header.seq + 1
  for line in io.lines('/proc/self/statm') do status.resident_bytes = tonumber(line:match('%d+ (%d+)')) * 4096 end
  bus:publish(prefix .. 'STAGE_STATUS', status:encode())
end

-- The newest 256 frames, so that a repeat is not counted twice; its answer is computed again. And what is missing
-- between the first and the last seq of each session.
local answered, newest = {}, {}
local sessions = {}
local function is_repeat(header)
  local key = header.camera .. '/' .. header.session
  local frame = key .. '/' .. header.seq
  if answered[frame] then return true end
  answered[frame] = true
  table.insert(newest, frame)
  if #newest > 256 then answered[table.remove(newest, 1)] = nil end
  local last = sessions[key]
  if last and header.seq > last then
    status.gaps = status.gaps + header.seq - last - 1
  elseif last and status.gaps > 0 then
    status.gaps = status.gaps - 1 -- it only came late
  end
  sessions[key] = math.max(last or header.seq, header.seq)
  return false
end

local function take(data)
  local received_us, cpu_s = now_us(), os.clock()
  local decoded, found = pcall(weft.part_detections_t.decode, data)
  if not decoded or found:encode() ~= data then
    status.decode_failures, status.last_error = status.decode_failures + 1, input .. ': cannot be decoded'
    return
  end
  local header = found.header
  if type(header.seq) ~= 'number' or header.seq < 0 or #header.camera == 0 or #header.camera > 128 then
    status.invalid_inputs, status.last_error = status.invalid_inputs + 1, input .. ': its header names no frame'
    return
  end
  local again = is_repeat(header)
  local answer = process(found)
  local bytes = answer:encode()
  local finished_us = now_us()
  bus:publish(prefix .. output, bytes)
  if again then
    status.repeats = status.repeats + 1
    return
  end
  local code = answer.status.code
  status.frames_in = status.frames_in + 1
  local counter = code == FAILED and 'frames_failed' or code == MISSING_INPUT and 'frames_missing_input' or 'frames_out'
  status[counter] = status[counter] + 1
  if code == FAILED then
    status.invalid_inputs, status.last_error = status.invalid_inputs + 1, answer.status.text
  end
  local timing = weft.stage_timing_t:new()
  timing.header, timing.stage, timing.host, timing.status_code = header, name, status.host, code
  timing.received_utime, timing.started_utime, timing.finished_utime = received_us, received_us, finished_us
  timing.published_utime, timing.cpu_us = now_us(), math.floor((os.clock() - cpu_s) * 1e6)
  timing.queue_length, timing.output_bytes = 1, #bytes
  bus:publish(prefix .. 'STAGE_TIMING', timing:encode())
end

-- An error may not leave a handler: LCM's C code is between it and the loop.
local failure
bus:subscribe(((prefix .. input):gsub('[^%w_]', '\\%0')), function(_, data)
  local good, why = pcall(take, data)
  if not good then failure = why end
end)
publish_status(0)
local function run()
  local told_us = 0
  while not failure do
    if now_us() - told_us >= 1e6 then
      publish_status(1)
      told_us = now_us()
    end
    bus:timedhandle(0.05)
  end
  error(failure, 0)
end
-- SIGINT is an error "interrupted!", raised after the call that it broke off has raised its own.
local _, why = pcall(function()
  local _, inner = pcall(run)
  socket.sleep(0)
  error(inner, 0)
end)
publish_status(2)
if not tostring(why):find('interrupted!', 1, true) then
  io.stderr:write('best_parts: ', tostring(why), '\n')
  os.exit(1)
end
