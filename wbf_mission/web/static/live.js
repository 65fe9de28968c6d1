"use strict";(()=>{function t(e){return e.time_s}})();
